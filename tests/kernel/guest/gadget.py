# SPDX-License-Identifier: Apache-2.0
"""USB devices made of the kernel's own functions (configfs), plugged into dummy_hcd."""

from pathlib import Path

from machine import modprobe, run

CONFIGFS = Path("/sys/kernel/config")
PORTS = 2  # dummy_udc.0, dummy_udc.1
LINUX_FOUNDATION = 0x1D6B


def load_bus() -> None:
    """Load the bus whose device side is in this kernel too: dummy_udc.0 and dummy_udc.1."""
    modprobe("dummy_hcd", f"num={PORTS}")


class Gadget:
    """One gadget with one function, such as `acm.usb0`; unplugged until plug()."""

    def __init__(
        self, name: str, function: str, product_id: int, vendor_id: int = LINUX_FOUNDATION,
        serial: str = "",
    ) -> None:  # fmt: skip
        load_bus()
        modprobe("libcomposite")
        if not (CONFIGFS / "usb_gadget").exists():
            run("mount", "-t", "configfs", "configfs", str(CONFIGFS))
        self._folder = CONFIGFS / "usb_gadget" / name
        (self._folder / "strings/0x409").mkdir(parents=True)
        (self._folder / "configs/c.1").mkdir()
        (self._folder / "functions" / function).mkdir()
        for attribute, value in (
            ("idVendor", f"{vendor_id:#06x}"),
            ("idProduct", f"{product_id:#06x}"),
            ("strings/0x409/manufacturer", "lightprobe"),
            ("strings/0x409/product", name),
            ("strings/0x409/serialnumber", serial or f"{name}-1"),
        ):
            (self._folder / attribute).write_text(value)
        link = self._folder / "configs/c.1" / function
        link.symlink_to(self._folder / "functions" / function)

    def plug(self, port: int = 0) -> None:
        """Attach to one of the bus's ports."""
        (self._folder / "UDC").write_text(f"dummy_udc.{port}")

    def unplug(self) -> None:
        """Detach, as pulling the cable does."""
        (self._folder / "UDC").write_text("\n")
