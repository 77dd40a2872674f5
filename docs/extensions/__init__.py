"""Parts of the documentation that are computed when it is built."""
