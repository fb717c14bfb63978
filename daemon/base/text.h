/* SPDX-License-Identifier: Apache-2.0 */
/* Text for bounded fields. */
#ifndef LP_BASE_TEXT_H
#define LP_BASE_TEXT_H

#include <stddef.h>
#include <stdint.h>

/*
 * Text of unknown origin (paths, device names, what peers send): the one place where it is made
 * harmless, for the log and for messages. Copy `from` into a field of `size_bytes` (at least
 * 8) as valid UTF-8 without control characters: bytes that are not UTF-8, and characters that
 * are hidden or change what is read (escape sequences of terminals, direction of text), become '?';
 * ASCII control characters become spaces. Text that is too long loses its middle, replaced by
 * "...": the beginning names the object, the end says what to do. Cuts between characters only. The
 * result ends with a zero byte. `from` must not overlap `to`.
 */
void lp_text_copy(char *to, size_t size_bytes, const char *from);

/* The numbers of the bits set in `mask`, ascending, as in "0, 3, 8"; "" when none is set. A list
 * that is too long for `size_bytes` is cut. */
void lp_text_list_bits(char *to, size_t size_bytes, uint32_t mask);

#endif
