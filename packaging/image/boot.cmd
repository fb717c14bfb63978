# SPDX-License-Identifier: Apache-2.0
# What the boot loader (U-Boot) does: it starts one of the two halves of the card, each a whole system of its own.
# `half.env` says which. An update has been written to the other one: the file `try` lets it start once, as a trial, and
# is removed before that. A system that does not start, or is not well (update.py), is followed by the one that was well.
setenv card ${devtype} ${devnum}
# A place that a kernel of up to 100 MB does not reach.
setexpr ramdisk_at ${ramdisk_addr_r} + 0x4000000
setenv half a
if load ${card}:1 ${kernel_addr_r} half.env; then env import -t -r ${kernel_addr_r} ${filesize} half; fi
load ${card}:1 ${kernel_addr_r} arguments.env && env import -t -r ${kernel_addr_r} ${filesize} arguments
if test "${half}" = b; then setenv other a; else setenv half a; setenv other b; fi
setenv order ${half} ${other}
setenv tried
if test -e ${card}:1 try; then
	# Where it cannot be removed, nothing is tried.
	if fatrm ${card}:1 try; then
		setenv order ${other} ${half}
		setenv tried ${other}
	fi
fi
for one in ${order}; do
	setenv trial
	if test "${one}" = "${tried}"; then setenv trial lightprobe.trial; fi
	if test ${one} = a; then setenv part 2; else setenv part 3; fi
	echo "half ${one} of the card starts ${trial}"
	setenv bootargs "${arguments} rauc.slot=${one} ${trial}"
	if load ${card}:${part} ${kernel_addr_r} /boot/vmlinuz; then
		if load ${card}:${part} ${ramdisk_at} /boot/initrd.img; then
			# A Raspberry Pi 4 has no other way to start again than its watchdog, which the kernel feeds once it has loaded
			# its module (the first of modules.txt). PM_WDOG and PM_RSTC arm it for 16 s: a trial that hangs before is over then.
			if test "${board}" = rpi -a -n "${trial}"; then
				mw.l 0xfe100024 0x5a0fffff
				mw.l 0xfe10001c 0x5a000020
			fi
			booti ${kernel_addr_r} ${ramdisk_at}:${filesize} ${fdt_addr}
		fi
	fi
done
reset
