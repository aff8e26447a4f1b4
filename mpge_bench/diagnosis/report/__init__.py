"""The result as a page for people."""
