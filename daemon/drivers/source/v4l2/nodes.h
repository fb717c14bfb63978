/* SPDX-License-Identifier: Apache-2.0 */
/* The video nodes of this machine, as sysfs shows them: no device is opened, no udev needed. */
#ifndef LP_SOURCE_V4L2_NODES_H
#define LP_SOURCE_V4L2_NODES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "drivers/source/v4l2/settings.h"

#define LP_V4L2_MAX_NODES 64

struct lp_v4l2_node {
	char path[64];			  /* /dev/video0 */
	char name[64];			  /* as the driver calls it */
	char id_name[LP_V4L2_NAME_BYTES]; /* as udev would link it in /dev/v4l/by-id; "": not USB */
	bool usb;			  /* what follows is valid */
	uint16_t vendor, product;
	char serial[64];	       /* "": the camera has none */
	char port[LP_V4L2_PORT_BYTES]; /* where it is plugged in: "1-1.2" */
	bool has_twin;	  /* another one has the same numbers: only the port tells them apart */
	int bus, address; /* of the USB device at present */
};

/* All nodes that may deliver pictures, at most `capacity`; returns how many. `sysfs`: "/sys". */
int lp_v4l2_nodes_read(const char *sysfs, struct lp_v4l2_node *nodes, int capacity);

/*
 * The node that is meant: `known`, once a camera has been used, is that very camera, wherever it
 * has come back; until then `target` decides. One that has a twin, or is named by its port, comes
 * back to its port only. Returns an index. -ENOENT: absent. -ENOTUNIQ: several
 * could be meant. `*reason` then says so, with what there is, and the next step.
 */
int lp_v4l2_nodes_select(const struct lp_v4l2_node *nodes, int count,
			 const struct lp_v4l2_target *target, const struct lp_v4l2_node *known,
			 char *reason, size_t reason_bytes);

#endif
