"""What each subcommand does. Heavy modules are imported inside, after everything that can be wrong was checked."""
