"""What figures share: colours, letters, headings, rendering."""
