"""The commands of the program, one file each: `add_arguments` fills the parser, `run` does the work."""
