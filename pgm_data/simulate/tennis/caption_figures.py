"""How many captions, words and seconds: the figures of the paper's table of its captions, for any captions."""

from collections.abc import Iterable
from dataclasses import dataclass

from pgm_data.simulate.states import Caption


@dataclass(frozen=True, eq=False, kw_only=True)
class CaptionFigures:
    """Counts over some captions; averages are NaN where there are none."""

    captions: int
    """Spans, each counted once by its main text."""
    distinct: int
    """Different main texts."""
    texts: int
    """Main texts and alternatives."""
    distinct_texts: int
    words: int
    """Different words in all texts; commas are none, hyphenated words are one."""
    average_words: float
    """Of the main texts."""
    fewest_words: int
    most_words: int
    """Over all texts; 0 where there are none."""
    average_span_s: float
    """Seconds."""


def words_of(text: str) -> list[str]:
    """The words of a text in order."""
    return text.replace(",", " ").split()


def figures_of(captions: Iterable[Caption]) -> CaptionFigures:
    """Figures of captions, which are read once and not kept."""
    count, main_words, seconds = 0, 0, 0.0
    main: set[str] = set()
    every: set[str] = set()
    texts, fewest, most = 0, 0, 0
    for caption in captions:
        lengths = [len(words_of(text)) for text in caption.texts]
        fewest = min(lengths) if count == 0 else min(fewest, *lengths)
        most = max(most, *lengths)
        count += 1
        main_words += lengths[0]
        seconds += caption.end_s - caption.start_s
        texts += len(caption.texts)
        main.add(caption.texts[0])
        every.update(caption.texts)
    return CaptionFigures(
        captions=count,
        distinct=len(main),
        texts=texts,
        distinct_texts=len(every),
        words=len({word for text in every for word in words_of(text)}),
        average_words=main_words / count if count else float("nan"),
        fewest_words=fewest,
        most_words=most,
        average_span_s=seconds / count if count else float("nan"),
    )
