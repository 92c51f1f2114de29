"""What every room uses and none owns: errors, units, tables of files, atomic writing, processes."""
