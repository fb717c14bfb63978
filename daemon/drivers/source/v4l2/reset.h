/* SPDX-License-Identifier: Apache-2.0 */
/* The last resort for a camera that hangs: resetting the USB port that it is plugged into. */
#ifndef LP_SOURCE_V4L2_RESET_H
#define LP_SOURCE_V4L2_RESET_H

struct lp_v4l2_node;

/*
 * The camera disappears and comes back, as if it had been replugged. Close it first. Blocks for up
 * to a few seconds. -EACCES: no permission; -EOPNOTSUPP: not USB, or built without libusb; -ENODEV:
 * gone.
 */
int lp_v4l2_reset_port(const struct lp_v4l2_node *node);

#endif
