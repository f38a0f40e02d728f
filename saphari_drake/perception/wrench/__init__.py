"""The wrench at a tool."""
