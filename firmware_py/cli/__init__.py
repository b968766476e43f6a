"""The subcommands of `rambler`, one module each: add_arguments(parser) and run(arguments) -> exit code."""
