"""Files on which a result depends: which they are, and whether they have changed.

locations          where a file lies: in this package, in an installed library, or with the user
package            the files of this package and one digest of them all
user_imports       what a user's case or solver file imports, by its syntax tree
opened_files       files that Python opens while such a file is loaded or run
environment_reads  environment variables that such a file looks up
regular_files      opening files that others may have made
plugins            case and solver files that installed packages bring
file_state         signature and digest of every file that was read
"""
