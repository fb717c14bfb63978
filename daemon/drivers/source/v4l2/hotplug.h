/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Coming and changing of video nodes. The kernel announces a node when it appears; udevd, where it
 * runs, announces it again when it has given the node its group and permissions. Both are heard, so
 * this works with udev and without, and for nodes that are not USB.
 */
#ifndef LP_SOURCE_V4L2_HOTPLUG_H
#define LP_SOURCE_V4L2_HOTPLUG_H

#include <stdbool.h>
#include <stddef.h>

/* A descriptor, readable when something was plugged or unplugged; -errno where it is not allowed.
 */
int lp_v4l2_hotplug_open(void);

/* Take all events that wait; is it worth to look at the video nodes again? Does not block. */
bool lp_v4l2_hotplug_read(int fd);

/* Does an event (of the kernel or of udevd) announce a video node that has come or changed? */
bool lp_v4l2_hotplug_is_news(const char *event, size_t size_bytes);

#endif
