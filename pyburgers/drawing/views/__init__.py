"""Views of the kinds of test, one module for each, and what several figures of a kind share."""
