"""What functions that take long tell of their progress where nobody listens: nothing."""


def silent(_: str) -> None:
    """Report to nobody."""
