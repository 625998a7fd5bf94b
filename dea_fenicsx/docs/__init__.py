"""Pages about the package, and the commands that make what they show: pictures and API pages."""
