"""Print the firmware's flash and RAM (stack as painted in simavr); fail above the budget."""

import argparse
import subprocess
import sys

from rig import ELF, symbols
from rig import start as start_rig


def sections() -> dict[str, int]:
    """Return the ELF's sections with their sizes in bytes."""
    text = subprocess.run(["avr-size", "-A", ELF], check=True, capture_output=True, text=True)
    rows = (line.split() for line in text.stdout.splitlines())
    return {row[0]: int(row[1]) for row in rows if len(row) == 3 and row[1].isdigit()}


def deepest_stack_bytes(carrier: str) -> int:
    """Ask everything of the firmware at once; return the deepest stack that left a trace."""
    with start_rig(carrier=carrier) as rig:
        rig.fit_feedback()
        rig.home()
        rig.ask("Rates", ring_scans=8, wheel_ms=10, counters_ms=50)
        rig.ask("ParamAction", wait_us=1_000_000, action="SAVE")
        for target in (180, 20):
            rig.start_move(target)
            for number in range(27):
                rig.ask("ParamGet", param=number)
            rig.status()
            rig.send("HelloRequest", protocol_major=9, protocol_minor=0)
            rig.run_until(rig.ended, 5_000_000)
        rig.set(stuck=1, ldr0_forced=1, supply_mv=3400)
        rig.run(1_200_000)
        assert rig.faults
        return int(rig.command(f"stack {symbols()['__heap_start']}").split()[1])


def main() -> int:
    """Measure, print, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flash-bytes", type=int, required=True)
    parser.add_argument("--ram-bytes", type=int, required=True)
    budget = parser.parse_args()
    size = sections()
    flash = size[".text"] + size[".data"]
    static = size[".data"] + size[".bss"] + size.get(".noinit", 0)
    stacks = {carrier: deepest_stack_bytes(carrier) for carrier in ("serial", "i2c", "can")}
    stack = max(stacks.values())
    print(f"flash {flash} of {budget.flash_bytes} bytes")
    print(f"RAM   {static + stack} of {budget.ram_bytes} bytes: static {static}, stack {stacks}")
    over = flash > budget.flash_bytes or static + stack > budget.ram_bytes
    if over:
        print("firmware-size: over budget: what is in build/firmware/lightprobe-mcu.map?")
    return over


if __name__ == "__main__":
    sys.exit(main())
