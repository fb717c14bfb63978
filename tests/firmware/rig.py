"""The firmware with its simulated box, driven in lock-step: time passes only in `run`.

target "avr": the flashed binary in simavr. "host": the same sources as a process, under sanitizers.
"""

import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from lightprobe.mcu import link as mcu_link
from lightprobe.mcu import messages as mcu

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "firmware"
ELF = BUILD / "lightprobe-mcu.elf"
RUNNER = BUILD / "lightprobe-mcu-simavr"
HOST = BUILD / "lightprobe-mcu-host-asan"
RELATIVE_JUMP_TO_ITSELF = "ffcf"
I2C_POLL_US = 2000
BOOT_US = 1_100_000  # the boot loader's second and the firmware's first words

Taken = tuple[int, float, float, tuple[int, bytes] | None]


@cache
def symbols() -> dict[str, int]:
    """Map symbol to address; data symbols without avr-gcc's 0x800000."""
    lines = subprocess.run(["avr-nm", ELF], check=True, capture_output=True, text=True).stdout
    rows = (line.split() for line in lines.splitlines())
    return {row[2]: int(row[0], 16) & 0x7FFFFF for row in rows if len(row) == 3}


def param_number(name: str) -> int:
    """Number of a parameter."""
    return {word: number for number, word in mcu.param_names().items()}[name]


@dataclass(frozen=True)
class Seen:
    """A message from the MCU, when its last byte left, and where the wheel was just before."""

    t_us: int
    low_deg: float
    high_deg: float
    event: mcu.Event


class Rig:
    """One chip. Use as a context manager."""

    def __init__(
        self, carrier: str = "serial", seed: int = 1, target: str = "avr", options: tuple = ()
    ) -> None:
        command = [HOST, "--lock-step"]
        if target == "avr":
            command = [RUNNER, ELF, "--carrier", carrier]
        command += ["--seed", str(seed), *options]
        self.carrier = carrier
        self.stretch_us = 0.0
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self.decoder = mcu.EventDecoder()
        self.bad_frames = 0
        self.token = 0
        self.wheel: mcu.WheelState | None = None
        self.wheel_seen: Seen | None = None
        self.faults: dict[str, mcu.Fault] = {}
        self.log: list[Seen] = []
        self.on_seen: Callable[[Seen], None] | None = None

    def __enter__(self) -> "Rig":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        self.process.stdin.close()
        self.process.wait()
        self.process.stdout.close()

    def command(self, line: str) -> str:
        """Send one command to the runner; raise RuntimeError when it answers with an error."""
        self.process.stdin.write(line + "\n")
        answer = self.process.stdout.readline().rstrip("\n")
        if answer.startswith("error") or (not answer and self.process.poll() is not None):
            raise RuntimeError(f"runner: {line[:60]}: {answer}")
        return answer

    def set(self, **numbers: float) -> None:
        """Set numbers of the box (board/host/world.h)."""
        for name, value in numbers.items():
            self.command(f"set {name} {value}")

    def exact_adc(self) -> None:
        """Give this chip a supply, an ADC and a reference without error, to compare numbers."""
        self.set(supply_mv=5000, adc_offset_lsb=0, bandgap_mv=1100)

    def reset(self, why: str = "external") -> list[Seen]:
        """Reset the chip and let its boot loader wait; return what has come since."""
        self.command(f"reset {why}")
        return self.run(BOOT_US)

    def get(self, name: str) -> float:
        """Read a number of the box."""
        return float(self.command(f"get {name}"))

    def run(self, us: int) -> list[Seen]:
        """Let time pass; return what the MCU sent, decoded."""
        if self.carrier != "i2c":
            self.command(f"run {us}")
            return self.take()
        seen = []
        end_us = int(self.command("time")) + us
        while (left_us := end_us - int(self.command("time"))) > 0:
            self.command(f"run {min(left_us, I2C_POLL_US)}")
            seen += self.take()
        return seen

    def take(self) -> list[Seen]:
        """Return what the MCU has sent since the last call; on I2C, read its mailbox empty."""
        seen = []
        for t_us, low, high, message in {
            "serial": self._serial_frames,
            "can": self._can_frames,
            "i2c": self._mails,
        }[self.carrier]():
            if message is None:
                self.bad_frames += 1
                continue
            event = self.decoder.decode(*message)
            if event is not None:
                seen.append(Seen(t_us, low, high, event))
        for item in seen:
            self._note(item)
        return seen

    def _lines(self, command: str) -> Iterator[tuple[int, float, float, str]]:
        for _ in range(int(self.command(command))):
            t_us, low, high, text = self.process.stdout.readline().split()
            yield int(t_us), float(low), float(high), text

    def _serial_frames(self) -> Iterator[Taken]:
        for t_us, low, high, text in self._lines("frames"):
            envelope = mcu_link.cobs_decode(bytes.fromhex(text)[:-1])
            message = mcu_link.unpack_envelope(envelope) if envelope is not None else None
            yield t_us, low, high, message

    def _can_frames(self) -> Iterator[Taken]:
        for t_us, low, high, text in self._lines("can frames"):
            identifier, data = text.split(":")
            yield t_us, low, high, (int(identifier, 16) - mcu_link.CAN_BASE, bytes.fromhex(data))

    def _mails(self) -> Iterator[Taken]:
        while (mail := self.read_mail())[0]:
            at = self.get("wheel_deg")
            message = mcu_link.unpack_envelope(mail[1 : 1 + mail[0]])
            yield int(self.command("time")), at, at, message

    def read_mail(self, count: int = 13) -> bytes:
        """Read so many bytes of the I2C mailbox."""
        got, stretch_us, *text = self.command(f"twi read {count}").split()
        assert int(got) == count, "not acknowledged"
        self.stretch_us = max(self.stretch_us, float(stretch_us))
        return bytes.fromhex(text[0])

    def write_mail(self, data: bytes) -> int:
        """Write to the I2C mailbox; return how many bytes were acknowledged."""
        got, stretch_us = self.command(f"twi write {data.hex()}").split()
        self.stretch_us = max(self.stretch_us, float(stretch_us))
        return int(got)

    def _note(self, item: Seen) -> None:
        if isinstance(item.event, mcu.WheelState):
            self.wheel = item.event
            self.wheel_seen = item
        if isinstance(item.event, mcu.Fault):
            if item.event.active:
                self.faults[item.event.name] = item.event
            else:
                self.faults.pop(item.event.name, None)
        if self.on_seen:
            self.on_seen(item)

    def send_bytes(self, data: bytes) -> None:
        """Put bytes on the serial line to the MCU."""
        self.command(f"tx {data.hex()}")

    def send(self, name: str, **signals: int | str) -> None:
        """Send one message of the DBC."""
        self.send_raw(*mcu.encode(name, **signals))

    def send_raw(self, message_id: int, payload: bytes) -> None:
        """Send one message, known or not."""
        if self.carrier == "serial":
            self.send_bytes(mcu_link.serial_frame(message_id, payload))
        elif self.carrier == "can":
            identifier = mcu_link.CAN_BASE + message_id
            assert self.command(f"can send {identifier:x} {payload.hex() or '-'}") == "ok"
        else:
            mail = mcu_link.i2c_mail(message_id, payload)
            assert self.write_mail(mail) == len(mail)

    def ask(self, name: str, wait_us: int = 20_000, **signals: int | str) -> mcu.Message:
        """Send a request and return its answer."""
        answers = {"HelloRequest": "Hello", "TimeRequest": "TimeReply"}
        answers |= {"WheelRequest": "WheelReply"}
        answers |= dict.fromkeys(("ParamGet", "ParamSet"), "ParamValue")
        request_id, _ = mcu.encode(name, **signals)
        self.send(name, **signals)
        for _ in range(wait_us // 1000):
            for item in self.run(1000):
                event = item.event
                if not isinstance(event, mcu.Message):
                    continue
                if event.name == answers.get(name):
                    return event
                if event.name == "Result" and event["request"] == request_id:
                    return event
        raise AssertionError(f"{name}: no answer within {wait_us} us")

    def param(self, name: str, value: int) -> None:
        """Set a parameter by its name."""
        assert self.ask("ParamSet", param=param_number(name), value=value)["value"] == value

    def param_value(self, name: str) -> int:
        """Read a parameter by its name."""
        return self.ask("ParamGet", param=param_number(name)).number("value")

    def run_until(self, done: Callable[[], bool], limit_us: int, step_us: int = 5000) -> None:
        """Let time pass until `done`; AssertionError after `limit_us`."""
        for _ in range(limit_us // step_us + 1):
            if done():
                return
            self.run(step_us)
        raise AssertionError(f"nothing after {limit_us} us; wheel {self.wheel}, {self.faults}")

    def phase(self) -> str:
        """Return the phase that the MCU reported last."""
        return self.wheel.phase.name if self.wheel else "NONE"

    def ended(self) -> bool:
        """Whether the newest command has come to its end, SETTLED or FAULT."""
        ours = self.wheel is not None and self.wheel.token == self.token
        return ours and self.phase() in ("SETTLED", "FAULT")

    def home(self) -> None:
        """Find the marks; the wheel is SETTLED at 0 afterwards, or in FAULT."""
        self.token = (self.token + 1) & 0xFF
        assert self.ask("WheelAction", token=self.token, action="HOME")["result"] == "OK"
        self.run_until(self.ended, 8_000_000)

    def fit_feedback(self) -> None:
        """Fit the feedback voltage, in the box and in the parameters."""
        self.set(feedback_fitted=1)
        self.param("feedback_zero_level", round(self.get("feedback_zero") * 4092))
        self.param("feedback_ddeg_fs", round(10 / self.get("feedback_per_deg")))

    def clear_faults(self) -> None:
        """Forget all latched faults."""
        assert self.ask("FaultClear", faults=0xFFFFFFFF)["result"] == "OK"
        self.run(30_000)

    def pulse(self, pulse_us: float) -> str:
        """Put the servo to a pulse; return the answer."""
        return str(self.ask("WheelPulse", pulse_hus=round(2 * pulse_us))["result"])

    def status(self) -> dict[str, mcu.Message]:
        """Ask for everything; return the messages by name."""
        self.send("StatusRequest", count=0)
        events = [item.event for item in self.run(20_000)]
        return {e.name: e for e in events if isinstance(e, mcu.Message)}

    def start_move(self, target_deg: float, slew_deg_s: float = 0, hold_s: float = 0) -> str:
        """Begin a move; return the answer."""
        self.token = (self.token + 1) & 0xFF
        numbers = (round(target_deg * 100), round(slew_deg_s * 10), round(hold_s * 10))
        names = ("target_cdeg", "slew_ddeg_s", "hold_ds")
        signals = dict(zip(names, numbers, strict=True))
        return str(self.ask("WheelMove", token=self.token, **signals)["result"])

    def move(self, target_deg: float) -> None:
        """Move; the wheel is SETTLED there afterwards, or in FAULT."""
        assert self.start_move(target_deg) == "OK"
        self.run_until(self.ended, 5_000_000)


def start(**options: object) -> Rig:
    """Return a rig that has said hello and whose rates are set."""
    rig = Rig(**options)
    rig.run(30_000)
    rig.ask("Rates", ring_scans=0, wheel_ms=20, counters_ms=0)
    return rig
