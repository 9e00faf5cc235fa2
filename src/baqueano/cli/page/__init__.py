"""Define the subcommands that open the page."""
