"""What is written on a figure, for tests."""

from matplotlib.figure import Figure
from matplotlib.text import Text


def legend_texts(figure: Figure) -> list[str]:
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes)]
    return [text.get_text() for legend in legends if legend for text in legend.get_texts()]


def texts(figure: Figure) -> list[Text]:
    """Everything written on a figure."""
    found = [artist for artist in figure.findobj(Text) if isinstance(artist, Text)]
    return [text for text in found if text.get_text() and text.get_visible()]
