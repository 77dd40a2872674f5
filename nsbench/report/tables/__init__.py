"""Build the tables of the report as plain data, one function per table."""
