"""Reading and writing of files: regular files up to a size limit, file modes, atomic writes."""
