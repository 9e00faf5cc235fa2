"""Write the page about each kind of result."""
