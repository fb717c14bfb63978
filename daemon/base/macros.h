/* SPDX-License-Identifier: Apache-2.0 */
/* What C lacks. */
#ifndef LP_BASE_MACROS_H
#define LP_BASE_MACROS_H

#include <stddef.h>

/* Elements of an array (not of a pointer to one). */
#define LP_COUNT(array) (sizeof(array) / sizeof((array)[0]))

/* The structure that embeds a member, from the member's address. */
#define LP_CONTAINER_OF(pointer, type, member) \
	((type *)(void *)(((char *)(pointer)) - offsetof(type, member)))

#endif
