/* SPDX-License-Identifier: Apache-2.0 */
/* What a camera file says to the driver: its section, and the camera's size and identity. */
#ifndef LP_SOURCE_PROFILE_H
#define LP_SOURCE_PROFILE_H

#include <stdbool.h>
#include <stdint.h>

#include "base/param.h"

struct lp_uri;

/* A driver's parameters: section of the camera file, and query of the URI. */
struct lp_profile_table {
	const char *section; /* the driver's scheme */
	const struct lp_param *params;
	size_t count;
	void *fields;
};

struct lp_usb_id {
	bool known;
	uint16_t vendor, product;
};

/* "1d6b:0102": four hexadecimal digits each. The characters read; 0: it is not that. */
size_t lp_usb_id_parse(const char *text, struct lp_usb_id *id);

/* Of [camera] the driver needs these; the rest belongs to the picture. */
struct lp_profile {
	struct lp_size size_px; /* 0x0: the file does not say */
	struct lp_usb_id usb;	/* as `match = usb:VENDOR:PRODUCT` says */
};

/*
 * Defaults, then the section of the camera file, then the query of the URI into table->fields.
 * `camera`: path of the camera file; NULL or "equirect": none. -EINVAL, -ENOENT, -EBADMSG: logged,
 * with the place.
 */
int lp_profile_read(const struct lp_uri *uri, const char *camera,
		    const struct lp_profile_table *table, struct lp_profile *profile);

#endif
