/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Who may open a WebSocket, decided from the texts of its handshake. Browsers let any page open a
 * WebSocket to any address and say in Origin which page it was; other programs send no Origin.
 */
#ifndef LP_WEBSOCKET_HANDSHAKE_H
#define LP_WEBSOCKET_HANDSHAKE_H

#include <stdbool.h>

#define LP_WEBSOCKET_PROTOCOL "lightprobe.v1"
/* Before the token, as one more of the protocols that the client offers: browsers can send no other
 * header. */
#define LP_WEBSOCKET_TOKEN_PREFIX "token."

/*
 * Whether a page of this origin may connect: none given (""), that of the host itself, or one of
 * `allowed`, origins with commas between them.
 */
bool lp_origin_is_ok(const char *origin, const char *host, const char *allowed);

/*
 * Whether `host` (of the Host header) can only mean this machine: an address, localhost, the name
 * of this machine, also with .local, or the host of an origin in `allowed`. Otherwise a foreign
 * page could let its own name point here, and Origin and Host would agree.
 */
bool lp_host_is_ok(const char *host, const char *machine, const char *allowed);

/* Whether the protocols that a client offers ("lightprobe.v1, token.abc") hold the token. Takes
 * equally long for all wrong tokens of one length. */
bool lp_token_is_offered(const char *protocols, const char *token);

#endif
