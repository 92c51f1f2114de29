"""The statements, figures and tables of the paper, beside what the fits say."""
