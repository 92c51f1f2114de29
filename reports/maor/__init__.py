"""The study of Maor, Hansen, Jerolmack and Goldsby: its statements, its sections of the page."""
