"""The subcommands of `rambler-hil`, one module each: add_arguments(parser) and run(arguments) -> exit code."""
