"""Messages about progress: where they go, and only there."""

import io
import logging

import pytest

from pyburgers.common.messages import messages_to

logger = logging.getLogger("pyburgers.test")


def test_messages_are_bare_and_stop_at_the_end_of_the_block(
    capfd: pytest.CaptureFixture[str],
) -> None:
    package = logging.getLogger("pyburgers")
    before = package.level, list(package.handlers)
    stream = io.StringIO()
    logger.info("before")
    with messages_to(stream):
        logger.info("one")
        logger.debug("details")
    logger.info("after")
    assert stream.getvalue() == "one\n"
    assert (package.level, package.handlers) == before
    assert capfd.readouterr() == ("", "")


def test_they_stop_after_an_error_too() -> None:
    package = logging.getLogger("pyburgers")
    before = package.level, list(package.handlers)
    with pytest.raises(KeyboardInterrupt), messages_to(io.StringIO()):
        raise KeyboardInterrupt
    assert (package.level, package.handlers) == before


def test_every_line_carries_the_name() -> None:
    stream = io.StringIO()
    with messages_to(stream, "PIL40"):
        logger.info("one\ntwo")
        logger.info("100 %")
    assert stream.getvalue() == "PIL40: one\nPIL40: two\nPIL40: 100 %\n"
