# SPDX-License-Identifier: Apache-2.0
# What the boot loader (U-Boot) does: it starts one of the two halves of the card, each a whole system of its own.
# `half.env` says which. An update has been written to the other one: the file `try` lets it start once, and is removed
# before that. So a system that does not start, or is not well (update.py), is followed by the one that was well.
setenv card ${devtype} ${devnum}
# A place that a kernel of up to 100 MB does not reach.
setexpr ramdisk_at ${ramdisk_addr_r} + 0x4000000
setenv half a
if load ${card}:1 ${kernel_addr_r} half.env; then env import -t ${kernel_addr_r} ${filesize} half; fi
load ${card}:1 ${kernel_addr_r} arguments.env && env import -t ${kernel_addr_r} ${filesize} arguments
if test "${half}" = b; then setenv other a; else setenv half a; setenv other b; fi
setenv order ${half} ${other}
if test -e ${card}:1 try; then
	# Where it cannot be removed, nothing is tried.
	if fatrm ${card}:1 try; then setenv order ${other} ${half}; fi
fi
for one in ${order}; do
	if test ${one} = a; then setenv part 2; else setenv part 3; fi
	echo "half ${one} of the card starts"
	setenv bootargs "${arguments} rauc.slot=${one}"
	if load ${card}:${part} ${kernel_addr_r} /boot/vmlinuz; then
		if load ${card}:${part} ${ramdisk_at} /boot/initrd.img; then
			booti ${kernel_addr_r} ${ramdisk_at}:${filesize} ${fdt_addr}
		fi
	fi
done
reset
