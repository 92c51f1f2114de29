"""From chain files to labelled draws."""
