"""Frozen encoders of text: features of each token, from a hash, from MiniLM, or from a T5 in a local folder.

Nothing here reaches the network: weights are read from files, and only from safetensors, which cannot carry code.
A text longer than an encoder takes is cut; its last token is always the end token.
"""

import hashlib
import json
import re
import sys
import unicodedata
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, final

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from torch import Tensor, nn

from pgm_data.weights import find_weights, sha256_of

if TYPE_CHECKING:
    from tokenizers import Tokenizer

MINILM_FILE = "minilm_l6_v2.safetensors"
"""File name of MiniLM's weights."""
MINILM_TOKENIZER_FILE = "minilm_l6_v2_tokenizer.json"
"""File name of MiniLM's tokenizer."""
TOKENS_OF_A_BATCH = 2048
"""Tokens, padding and all, that a network takes at once."""
DIGITS_OF_A_SUM = 16
"""Hexadecimal digits of a file's sha256 that an identity keeps."""


class TextEncoder(ABC):
    """Turns texts into features of their tokens, always in the same way."""

    name: str
    """As `encoder_of` calls its kind."""
    width: int
    """Numbers of a token's feature, E."""
    longest: int
    """Tokens that are kept of a text, the end token among them."""
    identity: str
    """Changes whenever the features of some text may change: the kind, and sums of the weights' files."""

    @abstractmethod
    def tokens(
        self, texts: Sequence[str], *, device: torch.device | str = "cpu"
    ) -> tuple[Float[Tensor, "U L E"], Bool[Tensor, "U L"]]:
        """Features of the tokens of each text, padded by zeros to the longest of them; and which are tokens.

        The last token of a text is its end token, also where the text was cut or is empty. Both tensors are on the
        CPU; there is no gradient.

        Args:
            texts: U of them, in any language; U may be 0.
            device: Where the network computes; it stays there.

        Raises:
            ValueError: If a text is no sequence of Unicode characters (a lone surrogate); names it.
        """


@final
class HashEncoder(TextEncoder):
    """Words as sums of pseudo-random vectors, of the word and of its trigrams; knows no language, needs no file.

    Spellings that share trigrams (`forehand`, `forehands`) are near each other, others are all but orthogonal. Each
    feature's numbers have a mean square of 1.
    """

    name = "hash"
    longest = 256

    def __init__(self, width: int = 64) -> None:
        if width < 1:
            raise ValueError(f"width: expected at least 1, got {width}")
        self.width = width
        self.identity = f"hash-1-{width}"

    def tokens(
        self, texts: Sequence[str], *, device: torch.device | str = "cpu"
    ) -> tuple[Float[Tensor, "U L E"], Bool[Tensor, "U L"]]:
        """See `TextEncoder.tokens`; the device does not matter."""
        _check(texts)
        end = torch.from_numpy(_hashed("", "end", self.width))
        features = []
        for text in texts:
            words = [torch.from_numpy(_word_vector(word, self.width)) for word in words_of(text)[: self.longest - 1]]
            features.append(torch.stack([*words, end]))
        return padded(features, self.width)


def words_of(text: str) -> list[str]:
    """Words in lower case; every other sign that is no space stands alone. Letters of one look are one letter."""
    return re.findall(r"\w+|[^\w\s]", unicodedata.normalize("NFKC", text).casefold())


@lru_cache(maxsize=1 << 14)
def _word_vector(word: str, width: int) -> Float32[np.ndarray, " width"]:
    """Half from the whole word, half from its trigrams, which see where the word begins and ends."""
    framed = f"<{word}>"
    pieces = [_hashed(framed[k : k + 3], "trigram", width) for k in range(len(framed) - 2)]
    vector = (_hashed(word, "word", width) + np.sum(pieces, axis=0) / np.sqrt(len(pieces))) / np.sqrt(2)
    return vector.astype(np.float32)


def _hashed(text: str, kind: str, width: int) -> Float32[np.ndarray, " width"]:
    """Numbers of mean square 1, the same in every process and on every machine."""
    blocks = (
        hashlib.blake2b(text.encode(), person=kind.encode(), salt=block.to_bytes(4, "little")).digest()
        for block in range(-(-width // hashlib.blake2b.MAX_DIGEST_SIZE))
    )
    numbers = np.frombuffer(b"".join(blocks), np.uint8)[:width].astype(np.float32)
    return (numbers - np.float32(127.5)) / np.float32(np.sqrt((256**2 - 1) / 12))


class _Output(Protocol):
    last_hidden_state: Tensor


class _NetworkEncoder(TextEncoder):
    """What encoders have in common that are a tokenizer and a transformer."""

    @cached_property
    def _tokenizer(self) -> "Tokenizer":
        raise NotImplementedError

    @cached_property
    def _network(self) -> nn.Module:
        raise NotImplementedError

    def tokens(
        self, texts: Sequence[str], *, device: torch.device | str = "cpu"
    ) -> tuple[Float[Tensor, "U L E"], Bool[Tensor, "U L"]]:
        """See `TextEncoder.tokens`. The first call reads the weights."""
        _check(texts)
        # One by one: the tokenizer's own threads would outlive a fork, and the network takes far longer.
        ids = [torch.tensor(self._tokenizer.encode(text).ids) for text in texts]
        network = self._network.to(device)
        features: list[Tensor] = [torch.empty(0)] * len(ids)
        for batch in _batches([len(one) for one in ids]):
            rows = [ids[row] for row in batch]
            numbers, mask = nn.utils.rnn.pad_sequence(rows, batch_first=True), _mask_of(rows).long()
            with torch.no_grad():
                output: _Output = network(input_ids=numbers.to(device), attention_mask=mask.to(device))
            for row, feature in zip(batch, output.last_hidden_state.float().cpu(), strict=True):
                features[row] = feature[: len(ids[row])]
        return padded(features, self.width)


@final
class MiniLmEncoder(_NetworkEncoder):
    """all-MiniLM-L6-v2: what its last layer says of each token, the start token first, the end token last.

    Raises:
        ValueError: If a file is missing; says the command that fetches it.
    """

    name = "minilm"
    width = 384
    longest = 128

    def __init__(self, *, weights: Path | None = None, tokenizer: Path | None = None, identity: str = "") -> None:
        """Find the files; they are read when texts come.

        Args:
            weights: Safetensors file; by default the fetched one.
            tokenizer: JSON file of the tokenizer; by default the fetched one.
            identity: Taken instead of the one that comes from the files, for a copy whose bytes differ.
        """
        self._weights_file = _found(weights, MINILM_FILE)
        self._tokenizer_file = _found(tokenizer, MINILM_TOKENIZER_FILE)
        self.identity = identity or _identity(self.name, (self._weights_file, self._tokenizer_file))

    @cached_property
    def _tokenizer(self) -> "Tokenizer":
        return _tokenizer_of(self._tokenizer_file, self.longest)

    @cached_property
    def _network(self) -> nn.Module:
        with _without_torchvision():
            from transformers import BertConfig, BertModel

        config = BertConfig(
            vocab_size=30522,
            hidden_size=self.width,
            num_hidden_layers=6,
            num_attention_heads=12,
            intermediate_size=1536,
            max_position_embeddings=512,
        )
        return _filled(BertModel(config, add_pooling_layer=False), [self._weights_file])


@final
class T5Encoder(_NetworkEncoder):
    """The encoder of a T5 as published: a folder with config.json, tokenizer.json and safetensors weights.

    Raises:
        ValueError: If the folder holds no T5, or only weights that are pickles, which may carry code.
    """

    name = "t5"
    longest = 512

    def __init__(self, path: Path | str) -> None:
        folder = Path(path)
        self._config = _t5_config(folder)
        self._weights_files = _t5_weights(folder)
        self._tokenizer_file = folder / "tokenizer.json"
        if not self._tokenizer_file.is_file():
            raise ValueError(f"{folder}: expected tokenizer.json of a T5, found no such file")
        self.width = int(str(self._config["d_model"]))
        self.identity = _identity(self.name, (folder / "config.json", *self._weights_files, self._tokenizer_file))

    @cached_property
    def _tokenizer(self) -> "Tokenizer":
        tokenizer = _tokenizer_of(self._tokenizer_file, self.longest)
        end = self._config.get("eos_token_id", 1)
        if tokenizer.encode("").ids != [end]:
            raise ValueError(f"{self._tokenizer_file}: expected a tokenizer that ends each text by token {end}")
        return tokenizer

    @cached_property
    def _network(self) -> nn.Module:
        with _without_torchvision():
            from transformers import T5Config, T5EncoderModel

        return _filled(T5EncoderModel(T5Config.from_dict(dict(self._config))), self._weights_files)


def encoder_of(name: str) -> TextEncoder:
    """The encoder of that name: `hash`, `minilm`, `minilm:FOLDER` with its two files, or `t5:FOLDER`.

    Raises:
        ValueError: If there is none of that name, or its files are missing.
    """
    kind, colon, place = name.partition(":")
    if name == "hash":
        return HashEncoder()
    if name == "minilm":
        return MiniLmEncoder()
    if kind == "minilm" and place:
        return MiniLmEncoder(weights=Path(place) / MINILM_FILE, tokenizer=Path(place) / MINILM_TOKENIZER_FILE)
    if kind == "t5" and place:
        return T5Encoder(place)
    raise ValueError(f"encoder: expected hash, minilm, minilm:FOLDER or t5:FOLDER, got {name!r}")


def padded(features: Sequence[Tensor], width: int) -> tuple[Float[Tensor, "U L E"], Bool[Tensor, "U L"]]:
    """Features of several texts in one tensor, zeros behind the shorter ones; and which are tokens."""
    if not features:
        return torch.zeros(0, 0, width), torch.zeros(0, 0, dtype=torch.bool)
    counts = torch.tensor([len(feature) for feature in features])
    return nn.utils.rnn.pad_sequence(list(features), batch_first=True), torch.arange(int(counts.max())) < counts[
        :, None
    ]


def _mask_of(rows: Sequence[Tensor]) -> Bool[Tensor, "U L"]:
    counts = torch.tensor([len(row) for row in rows])
    return torch.arange(int(counts.max())) < counts[:, None]


def _batches(lengths: Sequence[int]) -> list[list[int]]:
    """Rows by length, as many together as a batch may hold tokens."""
    batches: list[list[int]] = []
    for row in sorted(range(len(lengths)), key=lambda row: lengths[row]):
        if not batches or (len(batches[-1]) + 1) * lengths[row] > TOKENS_OF_A_BATCH:
            batches.append([])
        batches[-1].append(row)
    return batches


def _check(texts: Sequence[str]) -> None:
    if isinstance(texts, str):
        raise ValueError(f"texts: expected several texts, got one: {texts[:60]!r}")
    for row, text in enumerate(texts):
        try:
            text.encode()
        except UnicodeEncodeError as error:
            raise ValueError(f"texts: expected Unicode, got a lone surrogate in text {row}: {error}") from error


@contextmanager
def _without_torchvision() -> Iterator[None]:
    """Keep an import from finding torchvision.

    Transformers imports it where it is installed, though text needs none, and fails where it is of another torch.
    """
    hidden = "torchvision" not in sys.modules
    if hidden:
        sys.modules["torchvision"] = None  # pyright: ignore[reportArgumentType] - how the import system marks absence
    try:
        yield
    finally:
        if hidden:
            del sys.modules["torchvision"]


def _found(given: Path | None, file: str) -> Path:
    path = find_weights("text", file) if given is None else given
    if path is None:
        raise ValueError(f"{file}: expected the weights of MiniLM, found none; run `pgm weights text`")
    if not path.is_file():
        raise ValueError(f"{path}: expected a file of MiniLM, found none; `pgm weights text` fetches it")
    return path


def _identity(name: str, files: Sequence[Path]) -> str:
    return "-".join((name, *(sha256_of(file)[:DIGITS_OF_A_SUM] for file in files)))


def _tokenizer_of(file: Path, longest: int) -> "Tokenizer":
    from tokenizers import Tokenizer

    tokenizer = Tokenizer.from_file(str(file))
    tokenizer.no_padding()
    tokenizer.enable_truncation(longest)
    return tokenizer


def _filled(network: nn.Module, files: Sequence[Path]) -> nn.Module:
    """The network, frozen, with weights from those files; what they hold beside is left alone.

    Raises:
        ValueError: If a weight is missing or of another shape; names it.
    """
    from safetensors import SafetensorError, safe_open

    missing = dict(network.state_dict())
    for file in files:
        try:
            with safe_open(file, framework="pt") as weights:
                for name in set(weights.keys()) & set(missing):
                    missing.pop(name).copy_(weights.get_tensor(name))
        except (SafetensorError, RuntimeError) as error:
            raise ValueError(f"{file}: expected weights of {type(network).__name__}, got {error}") from error
    # Tensors under two names (T5 ties its embeddings) are filled under one of them.
    filled = {tensor.data_ptr() for name, tensor in network.state_dict().items() if name not in missing}
    absent = sorted(name for name, tensor in missing.items() if tensor.data_ptr() not in filled)
    if absent:
        raise ValueError(f"{files[0]}: expected {len(absent)} more weights, such as {absent[0]}")
    return network.float().eval().requires_grad_(False)


def _t5_config(folder: Path) -> Mapping[str, object]:
    try:
        config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"{folder}: expected the folder of a T5 with its config.json, got {error}") from error
    kind = config.get("model_type") if isinstance(config, dict) else None
    if kind != "t5" or not isinstance(config.get("d_model"), int):
        raise ValueError(f"{folder / 'config.json'}: model_type: expected 't5' with its d_model, got {kind!r}")
    return config


def _t5_weights(folder: Path) -> list[Path]:
    files = [folder / "model.safetensors"]
    if not files[0].is_file():
        files = sorted(folder.glob("model-*-of-*.safetensors"))
    if not files:
        pickles = sorted(path.name for pattern in ("*.bin", "*.pt", "*.pth") for path in folder.glob(pattern))
        rest = f"only {', '.join(pickles)}, which may carry code: convert it" if pickles else "none"
        raise ValueError(f"{folder}: expected model.safetensors, found {rest}")
    return files
