/* SPDX-License-Identifier: Apache-2.0 */
#include "base/usb_id.h"

#include <stdio.h>
#include <string.h>

#define HEX_DIGITS "0123456789abcdefABCDEF"

size_t lp_usb_id_parse(const char *text, struct lp_usb_id *id)
{
	int length = 0;

	if (strspn(text, HEX_DIGITS) != 4 ||
	    sscanf(text, "%4hx:%4hx%n", &id->vendor, &id->product, &length) != 2 || length != 9)
		return 0;
	id->known = true;
	return (size_t)length;
}
