"""The page about fits: figures, tables, sections."""
