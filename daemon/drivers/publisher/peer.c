/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/peer.h"

#include <arpa/inet.h>
#include <linux/tcp.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>

static uint64_t user_of(int fd)
{
	struct ucred credentials = {.uid = (uid_t)-1};
	socklen_t length = sizeof(credentials);

	(void)getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &credentials, &length);
	return credentials.uid;
}

/* A socket that listens for both has IPv4 addresses within IPv6 ones. */
static void read_in6(const struct in6_addr *address, struct lp_peer *peer)
{
	uint32_t ipv4;

	if (IN6_IS_ADDR_V4MAPPED(address)) {
		peer->family = AF_INET;
		memcpy(&ipv4, &address->s6_addr[12], sizeof(ipv4));
		peer->id = ipv4;
	} else {
		memcpy(&peer->id, address, sizeof(peer->id));
	}
}

void lp_peer_read(int fd, struct lp_peer *peer)
{
	struct sockaddr_storage address = {0};
	socklen_t length = sizeof(address);

	*peer = (struct lp_peer){0};
	if (getpeername(fd, (struct sockaddr *)&address, &length) < 0)
		return;
	peer->family = address.ss_family;
	if (address.ss_family == AF_INET)
		peer->id = ((const struct sockaddr_in *)&address)->sin_addr.s_addr;
	else if (address.ss_family == AF_INET6)
		read_in6(&((const struct sockaddr_in6 *)&address)->sin6_addr, peer);
	else
		peer->id = user_of(fd);
}

void lp_peer_describe(const struct lp_peer *peer, char *text, size_t size_bytes)
{
	const uint32_t ipv4 = (uint32_t)peer->id;
	struct in6_addr ipv6 = {0};
	char address[INET6_ADDRSTRLEN] = "";

	memcpy(&ipv6, &peer->id, sizeof(peer->id));
	if (peer->family == AF_INET)
		(void)inet_ntop(AF_INET, &ipv4, text, (socklen_t)size_bytes);
	else if (peer->family == AF_INET6)
		(void)snprintf(text, size_bytes, "%s/64",
			       inet_ntop(AF_INET6, &ipv6, address, sizeof(address)));
	else
		(void)snprintf(text, size_bytes, "user %d", (int)peer->id);
}

uint64_t lp_peer_sent_bytes(int fd)
{
	struct tcp_info info = {0};
	socklen_t length = sizeof(info);

	(void)getsockopt(fd, IPPROTO_TCP, TCP_INFO, &info, &length);
	return info.tcpi_bytes_received;
}

bool lp_peer_is_same(const struct lp_peer *a, const struct lp_peer *b)
{
	return a->family == b->family && a->id == b->id;
}
