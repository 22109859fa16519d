"""The commands of `ballbot`, a file each: `add_to` adds one to the parser, `run` carries it out."""
