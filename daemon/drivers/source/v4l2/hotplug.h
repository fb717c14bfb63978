/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Coming and going of video nodes, from the kernel's own event socket: works with udev and without
 * (libusb and libudev hear nothing where no udevd runs), and for nodes that are not USB.
 */
#ifndef LP_SOURCE_V4L2_HOTPLUG_H
#define LP_SOURCE_V4L2_HOTPLUG_H

#include <stdbool.h>

/* A descriptor, readable when something was plugged or unplugged; -errno where it is not allowed.
 */
int lp_v4l2_hotplug_open(void);

/* Take all events that wait; did a video node appear among them? Does not block. */
bool lp_v4l2_hotplug_read(int fd);

#endif
