"""The link in Python: golden bytes of proto/golden, framing, and streams that are damaged."""

import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lightprobe.mcu import link as mcu_link
from lightprobe.mcu import messages as mcu

GOLDEN = Path(__file__).resolve().parents[2] / "proto" / "golden" / "mcu.txt"
LINES = [line.split() for line in GOLDEN.read_text().splitlines() if not line.startswith("#")]
MESSAGES = st.sampled_from(sorted(mcu_link.lengths().items())).flatmap(
    lambda item: st.tuples(st.just(item[0]), st.binary(min_size=item[1], max_size=item[1]))
)


def signals_of(text: str) -> dict[str, int | str]:
    pairs = (pair.split("=") for pair in text.split(","))
    return {key: int(v) if v.lstrip("-").isdigit() else v for key, v in pairs}


@pytest.mark.parametrize("line", LINES, ids=lambda line: line[0])
def test_golden_messages_encode_and_decode_for_ever(line: list[str]) -> None:
    name, text, payload, serial, i2c = line
    message_id, encoded = mcu.encode(name, **signals_of(text))
    assert encoded.hex() == payload
    assert mcu.decode(message_id, encoded).signals == signals_of(text)
    assert mcu_link.serial_frame(message_id, encoded).hex() == serial
    assert mcu_link.SerialDecoder().feed(bytes.fromhex(serial)) == [(message_id, encoded)]
    assert mcu_link.i2c_mail(message_id, encoded).hex() == i2c
    assert mcu_link.unpack_envelope(bytes.fromhex(i2c)[1:]) == (message_id, encoded)


def test_every_message_of_the_dbc_has_a_golden_line() -> None:
    assert {m.name for m in mcu_link.database().messages} == {line[0] for line in LINES}


def test_every_message_fits_in_eight_bytes_and_has_its_own_id() -> None:
    messages = mcu_link.database().messages
    assert max(m.length for m in messages) <= mcu_link.MAX_PAYLOAD_BYTES
    assert len(mcu_link.lengths()) == len(messages)
    assert all(0 < message_id < 0x80 for message_id in mcu_link.lengths())


def test_crc_has_the_published_check_value() -> None:
    assert mcu_link.crc16(b"123456789") == 0x29B1


@given(st.binary(max_size=253))
def test_cobs_has_no_zero_and_comes_back(data: bytes) -> None:
    encoded = mcu_link.cobs_encode(data)
    assert 0 not in encoded
    assert len(encoded) == len(data) + 1
    assert mcu_link.cobs_decode(encoded) == data


@given(st.lists(MESSAGES, max_size=8), st.lists(st.integers(1, 20), min_size=1))
def test_a_stream_cut_anywhere_gives_the_same_messages(
    messages: list[tuple[int, bytes]], cuts: list[int]
) -> None:
    stream = b"".join(mcu_link.serial_frame(*m) for m in messages)
    decoder = mcu_link.SerialDecoder()
    received = []
    at = 0
    for size in cuts * (len(stream) + 1):
        if at >= len(stream):
            break
        received += decoder.feed(stream[at : at + size])
        at += size
    assert received == messages
    assert decoder.bad == 0


@given(st.binary(max_size=200), MESSAGES)
def test_after_any_noise_the_frame_after_next_is_received(
    noise: bytes, message: tuple[int, bytes]
) -> None:
    decoder = mcu_link.SerialDecoder()
    decoder.feed(noise + b"\0")
    assert decoder.feed(mcu_link.serial_frame(*message)) == [message]


@given(MESSAGES, st.integers(0, 200), st.integers(1, 255))
def test_no_single_wrong_byte_is_taken(message: tuple[int, bytes], at: int, error: int) -> None:
    frame = bytearray(mcu_link.serial_frame(*message))
    frame[at % (len(frame) - 1)] ^= error
    assert mcu_link.SerialDecoder().feed(bytes(frame)) == []


@given(MESSAGES, st.data())
def test_truncated_and_oversized_frames_are_dropped_and_counted(
    message: tuple[int, bytes], data: st.DataObject
) -> None:
    frame = mcu_link.serial_frame(*message)
    keep = data.draw(st.integers(1, len(frame) - 2))
    decoder = mcu_link.SerialDecoder()
    assert decoder.feed(frame[:keep] + b"\0") == []
    assert decoder.feed(b"\x01" * 300 + b"\0") == []
    assert decoder.bad == 2
    assert decoder.feed(frame) == [message]


@given(st.binary(max_size=20))
def test_a_wrong_length_of_a_known_id_is_no_message(payload: bytes) -> None:
    for message_id, length in mcu_link.lengths().items():
        if length != len(payload):
            assert mcu_link.unpack_envelope(mcu_link.pack_envelope(message_id, payload)) is None


def test_rings_are_joined_only_from_frames_of_one_counter() -> None:
    def part(name: str, counter: int) -> tuple[int, bytes]:
        message = mcu_link.database().get_message_by_name(name)
        signals = {s.name: 7 for s in message.signals} | {"counter": counter}
        return mcu.encode(name, **signals)

    decoder = mcu.EventDecoder()

    def feed(*parts: tuple[str, int]) -> list[mcu.Event]:
        events = [decoder.decode(*part(*p)) for p in parts]
        return [e for e in events if e is not None]

    rings = feed(("Ring0", 1), ("Ring1", 1), ("Ring2", 1))
    assert [r.counter for r in rings if isinstance(r, mcu.Ring)] == [1]
    assert feed(("Ring0", 2), ("Ring2", 2)) == []
    assert feed(("Ring0", 3), ("Ring1", 4), ("Ring2", 3)) == []
    assert feed(("Ring1", 5), ("Ring2", 5)) == []
    assert len(feed(("Ring0", 6), ("Ring0", 7), ("Ring1", 7), ("Ring2", 7))) == 1
    assert decoder.rings_lost == 5


def test_streaming_continues_at_one_percent_byte_errors() -> None:
    """20 000 frames here; the million runs in C (tests/firmware/test_noise.c)."""
    rng = random.Random(1)
    ids = sorted(mcu_link.lengths().items())
    decoder = mcu_link.SerialDecoder()
    good = wrong = 0
    for _ in range(20_000):
        message_id, length = rng.choice(ids)
        message = (message_id, rng.randbytes(length))
        frame = bytearray(mcu_link.serial_frame(*message))
        for k in range(len(frame)):
            if rng.random() < 0.01:
                frame[k] ^= rng.randrange(1, 256)
        for received in decoder.feed(bytes(frame)):
            good += received == message
            wrong += received != message
    assert wrong == 0
    assert good > 16_000
