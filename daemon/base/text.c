/* SPDX-License-Identifier: Apache-2.0 */
#include "base/text.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#define GAP "..."
#define GAP_BYTES (sizeof(GAP) - 1)

/* Bytes of the character at `text`, as UTF-8 is defined (RFC 3629: no overlong forms, no
 * surrogates, nothing above U+10FFFF); 0: it is none. Does not read beyond a zero byte. */
static size_t character_bytes(const uint8_t *text)
{
	const uint8_t first = text[0];
	uint8_t least = 0x80, most = 0xBF; /* of the second byte */
	size_t count;

	if (first < 0x80)
		return 1;
	if (first < 0xC2 || first > 0xF4)
		return 0;
	count = first < 0xE0 ? 2 : first < 0xF0 ? 3 : 4;
	if (first == 0xE0)
		least = 0xA0;
	else if (first == 0xED)
		most = 0x9F;
	else if (first == 0xF0)
		least = 0x90;
	else if (first == 0xF4)
		most = 0x8F;
	if (text[1] < least || text[1] > most)
		return 0;
	for (size_t i = 2; i < count; i++) {
		if (text[i] < 0x80 || text[i] > 0xBF)
			return 0;
	}
	return count;
}

/* Characters that no reader sees, and that change what is read: control characters (also the second
 * set, which terminals obey), separators of lines, and what turns the direction of text. */
static char replacement(const uint8_t *text, size_t count)
{
	static const struct {
		uint32_t first, last;
	} hidden[] = {{0x80, 0x9F},	{0xAD, 0xAD},	   {0x61C, 0x61C},   {0x180E, 0x180E},
		      {0x200B, 0x200F}, {0x2028, 0x202E},  {0x2060, 0x206F}, {0xFEFF, 0xFEFF},
		      {0xFFF9, 0xFFFB}, {0xE0000, 0xE007F}};
	uint32_t code;

	if (count == 0)
		return '?';
	if (count == 1)
		return text[0] < 0x20 || text[0] == 0x7F ? ' ' : (char)text[0];
	code = text[0] & (0x7FU >> count);
	for (size_t i = 1; i < count; i++)
		code = code << 6 | (text[i] & 0x3FU);
	for (size_t k = 0; k < sizeof(hidden) / sizeof(hidden[0]); k++)
		if (code >= hidden[k].first && code <= hidden[k].last)
			return '?';
	return '\0';
}

/* The characters of `from` whose last byte lies before `end`, cleaned, into `to`; returns their
 * bytes. A character that is replaced by one byte makes the result shorter, never longer. */
static size_t copy_clean(char *to, const char *from, const char *end)
{
	size_t used = 0;

	while (from < end) {
		const size_t count = character_bytes((const uint8_t *)from);

		if (from + (count ? count : 1) > end)
			break;
		const char instead = replacement((const uint8_t *)from, count);

		if (instead) {
			to[used++] = instead;
		} else {
			memcpy(to + used, from, count);
			used += count;
		}
		from += count ? count : 1;
	}
	return used;
}

/* Not in the middle of a character, at `at` or after. */
static const char *next_character(const char *at)
{
	while (((uint8_t)*at & 0xC0) == 0x80)
		at++;
	return at;
}

void lp_text_copy(char *to, size_t size_bytes, const char *from)
{
	const size_t length = strlen(from), room = size_bytes - 1;
	size_t used;

	if (length <= room) {
		used = copy_clean(to, from, from + length);
	} else {
		const size_t head = (room - GAP_BYTES) / 3;
		const size_t tail = room - GAP_BYTES - head;

		used = copy_clean(to, from, from + head);
		memcpy(to + used, GAP, GAP_BYTES);
		used += GAP_BYTES;
		used += copy_clean(to + used, next_character(from + length - tail), from + length);
	}
	to[used] = '\0';
}

void lp_text_list_bits(char *to, size_t size_bytes, uint32_t mask)
{
	size_t used = 0;

	to[0] = '\0';
	for (int k = 0; k < 32 && used < size_bytes; k++)
		if (mask >> k & 1)
			used += (size_t)snprintf(to + used, size_bytes - used, "%s%d",
						 used ? ", " : "", k);
}
