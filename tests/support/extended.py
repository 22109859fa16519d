"""Runs a module (`-m ballbot_rs.cli ...`) or code (`-c ...`) with another extension module in place of the library's.

Usage: python extended.py EXTENSION -m MODULE [ARGUMENT ...] | -c CODE
"""

import importlib.util
import runpy
import sys


def load_extension(path: str) -> None:
    """Makes the extension module at `path` the `ballbot_rs._core` of this process."""
    spec = importlib.util.spec_from_file_location("ballbot_rs._core", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)


if __name__ == "__main__":
    _, extension, flag, what, *arguments = sys.argv
    load_extension(extension)
    sys.argv = [what, *arguments]
    if flag == "-m":
        runpy.run_module(what, run_name="__main__", alter_sys=True)
    else:
        exec(compile(what, "<extended>", "exec"), {"__name__": "__main__"})
