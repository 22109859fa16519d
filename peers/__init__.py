"""The robot of `ballbot_rs.Params` in other engines, and small experiments that show whether it is one."""
