"""Requests to the microcontroller, over a carrier and a clock of the test's own."""

import errno
import itertools

import pytest
from lightprobe.mcu import messages as mcu
from lightprobe.mcu.link import McuError


class Line:
    """Answers every request from the `answers_from`-th on; sending takes `sending_s` each time."""

    def __init__(self, answers_from, sending_s):
        self.now_s, self.sent, self.ready = 0.0, 0, []
        self.answers_from, self.sending_s = answers_from, iter(sending_s)

    def mcu(self):
        return mcu.Mcu(self, now_ns=lambda: round(1e9 * self.now_s), sleep=self.sleep)

    def sleep(self, seconds):
        self.now_s += seconds

    def send(self, message_id, payload):
        self.sent += 1
        self.now_s += next(self.sending_s)
        if self.sent >= self.answers_from:
            signals = {"request": message_id, "result": "OK", "token": 0, "detail": 0}
            self.ready.append(mcu.encode("Result", **signals))

    def receive(self, timeout_s):
        if self.ready:
            return self.ready.pop(0)
        self.now_s += timeout_s
        return None

    def close(self):
        pass


def test_a_request_is_repeated_until_it_is_answered():
    line = Line(answers_from=10, sending_s=itertools.repeat(0.0))
    line.mcu().rates()
    assert line.sent == 10
    assert line.now_s == pytest.approx(0.9)


def test_silence_ends_after_the_time_it_was_given():
    line = Line(answers_from=99, sending_s=itertools.repeat(0.0))
    with pytest.raises(McuError, match="Rates: no answer in 1 s"):
        line.mcu().rates()
    assert line.now_s == pytest.approx(1.0)


def test_a_machine_that_stops_for_a_while_loses_one_try():
    line = Line(answers_from=2, sending_s=[3.0, 0.0])
    line.mcu().rates()
    assert line.sent == 2


class StartingDevice(Line):
    """Nobody acknowledges on I2C until the firmware runs."""

    def send(self, message_id, payload):
        super().send(message_id, payload)
        if self.sent < self.answers_from:
            raise OSError(errno.EREMOTEIO, "no acknowledge")


def test_a_device_that_starts_is_waited_for():
    line = StartingDevice(answers_from=5, sending_s=itertools.repeat(0.0))
    line.mcu().rates()
    assert line.sent == 5
    assert line.now_s == pytest.approx(0.4)


def test_a_device_that_never_acknowledges_is_told():
    line = StartingDevice(answers_from=99, sending_s=itertools.repeat(0.0))
    with pytest.raises(OSError, match="no acknowledge"):
        line.mcu().rates()
    assert line.now_s == pytest.approx(0.9)
