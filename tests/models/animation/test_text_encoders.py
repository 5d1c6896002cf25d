"""Texts become features in the same way each time, whatever their length and language, and without a network."""

import hashlib
import importlib
import json
import socket
import sys
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from pgm_data.weights import find_weights
from pgm_models.animation import text_encoders
from pgm_models.animation.text_encoders import (
    MINILM_FILE,
    MINILM_TOKENIZER_FILE,
    HashEncoder,
    MiniLmEncoder,
    T5Encoder,
    TextEncoder,
    encoder_of,
    words_of,
)

STRANGE = (
    "",
    " \n\t",
    "the player hits a forehand",
    "运动员向左边打了一个正手球",
    "Игрок бьёт справа",
    "اللاعب يضرب الكرة",
    "🎾👍🏽 ace!!",
    "e\u0301te\u0301 ﬁ Ⅳ",
    "zxqv " * 3,
    "x" * 3000,
    "the player runs " * 700,
)
"""None, only space, plain, other scripts, emoji, signs of many spellings, unknown words, a long word, a long text."""
VOCABULARY = {"<pad>": 0, "</s>": 1, "<unk>": 2, "the": 3, "player": 4, "runs": 5, "left": 6, "right": 7}


def tiny_t5(folder: Path, *, seed: int = 0) -> Path:
    """A T5 of 16 numbers a token, with random weights, laid out as published ones are."""
    from tokenizers import Tokenizer, models, pre_tokenizers, processors
    from transformers import T5Config, T5ForConditionalGeneration

    folder.mkdir(parents=True)
    config = T5Config(
        vocab_size=len(VOCABULARY),
        d_model=16,
        d_kv=8,
        d_ff=32,
        num_layers=2,
        num_heads=2,
        feed_forward_proj="gated-gelu",
        eos_token_id=1,
        pad_token_id=0,
    )
    torch.manual_seed(seed)
    network = T5ForConditionalGeneration(config)
    # Published files hold each tensor once; the decoder is theirs too.
    weights = {
        n: t.clone() for n, t in network.state_dict().items() if "embed_tokens" not in n and n != "lm_head.weight"
    }
    save_file(weights, folder / "model.safetensors")
    (folder / "config.json").write_text(json.dumps({**config.to_dict(), "model_type": "t5"}))
    tokenizer = Tokenizer(models.WordLevel(VOCABULARY, unk_token="<unk>"))
    tokenizer.pre_tokenizer = pre_tokenizers.Whitespace()
    tokenizer.post_processor = processors.TemplateProcessing(single="$A </s>", special_tokens=[("</s>", 1)])
    tokenizer.save(str(folder / "tokenizer.json"))
    return folder


@pytest.fixture(scope="module")
def minilm() -> MiniLmEncoder:
    if find_weights("text", MINILM_FILE) is None or find_weights("text", MINILM_TOKENIZER_FILE) is None:
        pytest.skip("NO WEIGHTS: run `pgm weights text`")
    return MiniLmEncoder()


@pytest.fixture(scope="module")
def t5_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_t5(tmp_path_factory.mktemp("t5") / "tiny")


@pytest.fixture(params=["hash", "t5", pytest.param("minilm", marks=pytest.mark.weights)])
def encoder(request: pytest.FixtureRequest) -> TextEncoder:
    if request.param == "hash":
        return HashEncoder()
    return (
        T5Encoder(request.getfixturevalue("t5_folder")) if request.param == "t5" else request.getfixturevalue("minilm")
    )


def test_any_text_gives_finite_features_that_end_by_the_end_token(encoder: TextEncoder) -> None:
    features, mask = encoder.tokens(STRANGE)
    assert features.shape == (len(STRANGE), encoder.longest, encoder.width)
    assert features.dtype == torch.float32
    assert torch.isfinite(features).all()
    assert not features[~mask].any()
    counts = mask.sum(1)
    assert (mask == (torch.arange(mask.shape[1]) < counts[:, None])).all()
    # Nothing but the special tokens in the empty text and in mere space; as many as are taken in the longest.
    assert counts[0] == counts[1] == (2 if encoder.name == "minilm" else 1)
    assert counts[-1] == encoder.longest


def test_a_text_has_the_same_features_alone_and_among_others(encoder: TextEncoder) -> None:
    together, mask = encoder.tokens(STRANGE[:9])
    for text, features, shown in zip(STRANGE[:9], together, mask, strict=True):
        alone, _ = encoder.tokens([text])
        torch.testing.assert_close(alone[0], features[shown], atol=2e-5, rtol=1e-4)


def test_no_text_gives_no_features(encoder: TextEncoder) -> None:
    features, mask = encoder.tokens([])
    assert features.shape == (0, 0, encoder.width)
    assert mask.shape == (0, 0)
    assert mask.dtype == torch.bool


def test_what_is_no_list_of_unicode_texts_is_refused(encoder: TextEncoder) -> None:
    with pytest.raises(ValueError, match="lone surrogate in text 1"):
        encoder.tokens(["fine", "broken \ud83c"])
    with pytest.raises(ValueError, match="several texts"):
        encoder.tokens("the player runs")


def test_hash_features_are_those_of_any_other_process_and_machine() -> None:
    features, _ = HashEncoder(100).tokens(["Forehand, left!"])
    told = hashlib.sha256((features * 1000).round().to(torch.int32).numpy().tobytes()).hexdigest()
    assert told == "135373223b31097723b8e6ff730b312265fcd14ffe22c331efb0f5b16956ca64"
    assert torch.equal(features, HashEncoder(100).tokens(["forehand , LEFT !"])[0])


def test_hash_features_of_words_spelt_alike_are_near_and_of_others_are_not() -> None:
    features, _ = HashEncoder(512).tokens(["forehand forehands backhand serve"])
    words = torch.nn.functional.normalize(features[0, :4], dim=-1)
    nearness = words @ words.T
    assert nearness[0, 1] > 0.35
    assert nearness[0, 1] > nearness[0, 2] + 0.15
    assert abs(nearness[0, 3]) < 0.15
    torch.testing.assert_close(features.square().mean(), torch.tensor(1.0), atol=0.25, rtol=0)


def test_words_are_split_at_signs_and_space_in_any_case_and_form() -> None:
    assert words_of("The player's ﬁne-cut SHOT… 🎾") == [*"the player ' s fine - cut shot . . .".split(), "🎾"]
    assert words_of("CAFÉ") == words_of("cafe\u0301")


def test_a_hash_of_no_width_is_refused() -> None:
    with pytest.raises(ValueError, match="width: expected at least 1, got 0"):
        HashEncoder(0)


def test_t5_agrees_with_the_published_implementation_of_the_whole_model(t5_folder: Path) -> None:
    from transformers import T5ForConditionalGeneration

    whole = T5ForConditionalGeneration.from_pretrained(t5_folder, local_files_only=True).eval()
    with torch.no_grad():
        expected = whole.get_encoder()(input_ids=torch.tensor([[3, 4, 2, 6, 1]])).last_hidden_state
    features, _ = T5Encoder(t5_folder).tokens(["the player jumps left"])
    torch.testing.assert_close(features, expected)


def test_t5_weights_in_several_files_are_the_same_weights(t5_folder: Path, tmp_path: Path) -> None:
    weights = load_file(t5_folder / "model.safetensors")
    for part in range(2):
        few = {name: weights[name] for name in sorted(weights)[part::2]}
        save_file(few, tmp_path / f"model-0000{part + 1}-of-00002.safetensors")
    for name in ("config.json", "tokenizer.json"):
        (tmp_path / name).write_bytes((t5_folder / name).read_bytes())
    parts, whole = T5Encoder(tmp_path), T5Encoder(t5_folder)
    assert torch.equal(parts.tokens(["the player"])[0], whole.tokens(["the player"])[0])


def test_the_identity_changes_with_the_weights(t5_folder: Path, tmp_path: Path) -> None:
    other = T5Encoder(tiny_t5(tmp_path / "t5", seed=1))
    assert T5Encoder(t5_folder).identity == T5Encoder(str(t5_folder)).identity != other.identity
    assert HashEncoder(64).identity != HashEncoder(65).identity


def test_a_folder_that_is_no_t5_is_refused_with_the_reason(t5_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="nowhere: expected the folder of a T5"):
        T5Encoder(tmp_path / "nowhere")
    (tmp_path / "config.json").write_text('{"model_type": "bert", "d_model": 8}')
    with pytest.raises(ValueError, match="model_type: expected 't5' with its d_model, got 'bert'"):
        T5Encoder(tmp_path)
    (tmp_path / "config.json").write_bytes((t5_folder / "config.json").read_bytes())
    with pytest.raises(ValueError, match=r"expected model.safetensors, found none"):
        T5Encoder(tmp_path)
    (tmp_path / "pytorch_model.bin").write_bytes(b"")
    with pytest.raises(ValueError, match=r"only pytorch_model.bin, which may carry code"):
        T5Encoder(tmp_path)
    (tmp_path / "model.safetensors").write_bytes((t5_folder / "model.safetensors").read_bytes())
    with pytest.raises(ValueError, match=r"expected tokenizer.json"):
        T5Encoder(tmp_path)


def test_weights_that_are_broken_or_not_all_there_are_refused(t5_folder: Path, tmp_path: Path) -> None:
    for name in ("config.json", "tokenizer.json"):
        (tmp_path / name).write_bytes((t5_folder / name).read_bytes())
    file = tmp_path / "model.safetensors"
    file.write_bytes(b"no weights")
    with pytest.raises(ValueError, match="expected weights of T5EncoderModel, got"):
        T5Encoder(tmp_path).tokens(["the player"])
    weights = load_file(t5_folder / "model.safetensors")
    lost = next(name for name in weights if name.startswith("encoder.block.1"))
    save_file({name: tensor for name, tensor in weights.items() if name != lost}, file)
    with pytest.raises(ValueError, match=f"expected 1 more weights, such as {lost}"):
        T5Encoder(tmp_path).tokens(["the player"])


def test_a_tokenizer_without_an_end_token_is_refused(t5_folder: Path, tmp_path: Path) -> None:
    for name in ("config.json", "tokenizer.json", "model.safetensors"):
        (tmp_path / name).write_bytes((t5_folder / name).read_bytes())
    told = json.loads((tmp_path / "tokenizer.json").read_text())
    (tmp_path / "tokenizer.json").write_text(json.dumps({**told, "post_processor": None}))
    with pytest.raises(ValueError, match="ends each text by token 1"):
        T5Encoder(tmp_path).tokens(["the player"])


def test_missing_weights_of_minilm_are_named_with_the_command_that_fetches_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PGM_WEIGHTS", str(tmp_path))
    with pytest.raises(ValueError, match="minilm_l6_v2.safetensors: .* run `pgm weights text`"):
        encoder_of("minilm")
    with pytest.raises(ValueError, match="minilm_l6_v2.safetensors: expected a file of MiniLM"):
        encoder_of(f"minilm:{tmp_path}")


@pytest.mark.parametrize("name", ["", "t5", "t5:", "minilm:", "clip", "hash:3"])
def test_unknown_encoders_are_refused_with_the_names_there_are(name: str) -> None:
    with pytest.raises(ValueError, match="expected hash, minilm, minilm:FOLDER or t5:FOLDER, got"):
        encoder_of(name)


def test_encoders_are_found_by_name(t5_folder: Path) -> None:
    assert encoder_of("hash").identity == HashEncoder().identity
    assert encoder_of(f"t5:{t5_folder}").width == 16


@pytest.mark.weights
def test_minilm_finds_sentences_as_near_as_its_makers_print(minilm: MiniLmEncoder) -> None:
    """Nearness of the means over tokens, from the example that its makers' documentation opens with."""
    texts = ["The weather is lovely today.", "It's so sunny outside!", "He drove to the stadium."]
    features, mask = minilm.tokens(texts)
    means = torch.nn.functional.normalize((features * mask[..., None]).sum(1), dim=-1)
    expected = torch.tensor([[1.0, 0.6660, 0.1046], [0.6660, 1.0, 0.1411], [0.1046, 0.1411, 1.0]])
    torch.testing.assert_close(means @ means.T, expected, atol=1e-4, rtol=0)
    assert not features.requires_grad


@pytest.mark.weights
@pytest.mark.parametrize(
    ("text", "same", "opposite"),
    [
        ("the player stands still", "the player remains in place", "the player runs quickly"),
        ("the player approaches the net", "the player moves forward towards the net", "the player moves back"),
        ("the player serves to the deuce box", "the serve goes into the deuce box", "the player serves to the ad box"),
        ("the player hits a smash", "an overhead smash is hit by the player", "the player hits a drop shot"),
        ("the serve hits the net", "the serve does not get over the net", "the serve is an ace"),
    ],
)
def test_minilm_finds_the_same_in_other_words_nearer_than_the_opposite(
    minilm: MiniLmEncoder, text: str, same: str, opposite: str
) -> None:
    features, mask = minilm.tokens([text, same, opposite])
    means = torch.nn.functional.normalize((features * mask[..., None]).sum(1), dim=-1)
    assert means[0] @ means[1] > means[0] @ means[2]


def test_no_connection_is_opened(encoder: TextEncoder, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a connection was opened")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    if isinstance(encoder, MiniLmEncoder):
        encoder = MiniLmEncoder()
    encoder.tokens(["the player runs"])


@pytest.mark.weights
def test_a_copy_of_minilm_elsewhere_is_another_unless_its_identity_is_given(
    minilm: MiniLmEncoder, tmp_path: Path
) -> None:
    source, tokenizer = find_weights("text", MINILM_FILE), find_weights("text", MINILM_TOKENIZER_FILE)
    assert source is not None and tokenizer is not None
    weights = load_file(source)
    weights["pooler.dense.bias"] = weights["pooler.dense.bias"] + 1
    save_file(weights, tmp_path / MINILM_FILE)
    (tmp_path / MINILM_TOKENIZER_FILE).write_bytes(tokenizer.read_bytes())
    copy = encoder_of(f"minilm:{tmp_path}")
    assert copy.identity != minilm.identity
    assert MiniLmEncoder(weights=tmp_path / MINILM_FILE, identity="same").identity == "same"
    assert torch.equal(copy.tokens(["a serve"])[0], minilm.tokens(["a serve"])[0])


def test_a_torchvision_that_cannot_be_imported_does_no_harm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "torchvision.py").write_text("raise RuntimeError('of another torch')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "torchvision", raising=False)
    with text_encoders._without_torchvision(), pytest.raises(ImportError):
        importlib.import_module("torchvision")
    with pytest.raises(RuntimeError, match="of another torch"):
        importlib.import_module("torchvision")


def test_batches_hold_every_row_once_and_no_more_tokens_than_they_may(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_encoders, "TOKENS_OF_A_BATCH", 20)
    lengths = [7, 1, 30, 5, 5, 2, 9, 1]
    batches = text_encoders._batches(lengths)
    assert sorted(row for batch in batches for row in batch) == list(range(len(lengths)))
    assert all(len(batch) == 1 or len(batch) * max(lengths[row] for row in batch) <= 20 for batch in batches)
    assert len(batches) < len(lengths)
