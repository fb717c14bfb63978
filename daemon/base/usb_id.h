/* SPDX-License-Identifier: Apache-2.0 */
/* Vendor and product of a USB device, as lsusb prints them. */
#ifndef LP_BASE_USB_ID_H
#define LP_BASE_USB_ID_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct lp_usb_id {
	bool known;
	uint16_t vendor, product;
};

/* "1d6b:0102": four hexadecimal digits each. Returns the characters read; 0: it is not that. */
size_t lp_usb_id_parse(const char *text, struct lp_usb_id *id);

#endif
