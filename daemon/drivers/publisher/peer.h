/* SPDX-License-Identifier: Apache-2.0 */
/* Who is at the other end of a connection: an address, or a user of this machine. */
#ifndef LP_PUBLISHER_PEER_H
#define LP_PUBLISHER_PEER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct lp_peer {
	int family; /* AF_UNIX, AF_INET, AF_INET6; 0: not known, which is a peer of its own */
	/* User id, IPv4 address, or the first 64 bits of an IPv6 address: one host has them all. */
	uint64_t id;
};

void lp_peer_read(int fd, struct lp_peer *peer);
/* "192.0.2.1", "2001:db8:0:1::/64", "user 1000". */
void lp_peer_describe(const struct lp_peer *peer, char *text, size_t size_bytes);

/* Bytes that have come on a TCP connection since it began, of any kind; 0: it is none. */
uint64_t lp_peer_sent_bytes(int fd);

bool lp_peer_is_same(const struct lp_peer *a, const struct lp_peer *b);

#endif
