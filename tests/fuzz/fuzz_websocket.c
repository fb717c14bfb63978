/* SPDX-License-Identifier: Apache-2.0 */
/* What a client may write into the handshake of a WebSocket: Host, Origin and protocols, a line
 * each; then the origins that its owner allows, and the machine's name. */
#include "fuzz.h"

#include <stdbool.h>
#include <string.h>

#include "drivers/publisher/websocket/handshake.h"

#define TOKEN "kX3vJ8"

enum { HOST, ORIGIN, PROTOCOLS, ALLOWED, MACHINE, TEXTS };

/* The next line as a text of exactly its length: what is beyond it is a fault. */
static char *take_line(const uint8_t **data, size_t *size)
{
	const uint8_t *end = *size ? memchr(*data, '\n', *size) : NULL;
	const size_t bytes = end ? (size_t)(end - *data) : *size;
	char *text = malloc(bytes + 1);

	fuzz_assert(text != NULL);
	memcpy(text, *data, bytes);
	text[bytes] = '\0';
	*data += bytes + (end != NULL);
	*size -= bytes + (end != NULL);
	return text;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	char *text[TEXTS];

	for (int i = 0; i < TEXTS; i++)
		text[i] = take_line(&data, &size);
	if (lp_host_is_ok(text[HOST], text[MACHINE], text[ALLOWED]))
		fuzz_assert(text[HOST][0] != '\0');
	/* Without a list, only the page of this host. */
	if (text[ORIGIN][0] && lp_origin_is_ok(text[ORIGIN], text[HOST], ""))
		fuzz_assert(strlen(text[ORIGIN]) > strlen(text[HOST]) && text[HOST][0]);
	(void)lp_origin_is_ok(text[ORIGIN], text[HOST], text[ALLOWED]);
	if (lp_token_is_offered(text[PROTOCOLS], TOKEN))
		fuzz_assert(strstr(text[PROTOCOLS], LP_WEBSOCKET_TOKEN_PREFIX TOKEN) != NULL);
	for (int i = 0; i < TEXTS; i++)
		free(text[i]);
	return 0;
}
