/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/listen.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netdb.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "base/log.h"

#define BACKLOG 128
#define SOCKET_FLAGS (SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK)

static const char *next_step(int ret)
{
	switch (-ret) {
	case EADDRINUSE:
		return " — does another lightprobed run? choose another --publish";
	case EACCES:
		return " — this user may not use the address; choose another --publish";
	case EADDRNOTAVAIL:
		return " — no interface of this machine has the address";
	default:
		return "";
	}
}

static int listen_error(const char *object, const char *stage, int ret)
{
	lp_error(object, stage, "%s%s", lp_strerror(ret), next_step(ret));
	return ret;
}

/* ---------------------------------------------------------------- TCP */

static bool is_port(const char *text)
{
	return *text && strspn(text, "0123456789") == strlen(text) && strlen(text) <= 5 &&
	       strtol(text, NULL, 10) <= UINT16_MAX;
}

/* HOST:PORT or [HOST]:PORT. False: neither. */
static bool split_address(const char *text, struct lp_tcp_address *address)
{
	const char *colon = strrchr(text, ':');
	const bool has_brackets = text[0] == '[' && colon && colon[-1] == ']';
	const char *host = text + has_brackets;
	size_t length;

	if (!colon || !is_port(colon + 1))
		return false;
	length = (size_t)(colon - host) - has_brackets;
	if (length == 0 || length >= sizeof(address->host))
		return false;
	memcpy(address->host, host, length);
	address->host[length] = '\0';
	memcpy(address->port, colon + 1, strlen(colon + 1) + 1);
	if (strpbrk(address->host, "[]"))
		return false;
	return has_brackets || !strchr(address->host, ':'); /* IPv6 needs brackets */
}

int lp_tcp_address_parse(const char *object, const char *text, struct lp_tcp_address *address)
{
	if (split_address(text, address))
		return 0;
	lp_error(object, "parse",
		 "must be %.*s:HOST:PORT with a port up to 65535; IPv6 in brackets: [::1]:7700",
		 (int)strcspn(object, ":"), object);
	return -EINVAL;
}

bool lp_tcp_address_is_loopback(const struct lp_tcp_address *address)
{
	struct in_addr ipv4;
	struct in6_addr ipv6;

	if (inet_pton(AF_INET, address->host, &ipv4) == 1)
		return ntohl(ipv4.s_addr) >> 24 == IN_LOOPBACKNET;
	if (inet_pton(AF_INET6, address->host, &ipv6) == 1)
		return IN6_IS_ADDR_LOOPBACK(&ipv6);
	return strcmp(address->host, "localhost") == 0;
}

int lp_tcp_address_check_open(const char *object, const struct lp_tcp_address *address,
			      bool insecure_lan)
{
	if (lp_tcp_address_is_loopback(address))
		return 0;
	if (insecure_lan) {
		lp_warning(object, "open",
			   "anyone on the network can read the light, and nothing is encrypted "
			   "(--insecure-lan)");
		return 1;
	}
	lp_error(object, "open",
		 "is open to the network without encryption — publish on wss: (lightprobe pair "
		 "makes what it needs), or accept this with --insecure-lan");
	return -EACCES;
}

/* What was bound, for the log: port 0 has become a number by now. */
static void log_listening(const char *object, int fd)
{
	struct sockaddr_storage bound;
	socklen_t length = sizeof(bound);
	char host[64], port[16];

	if (getsockname(fd, (struct sockaddr *)&bound, &length) == 0 &&
	    getnameinfo((struct sockaddr *)&bound, length, host, sizeof(host), port, sizeof(port),
			NI_NUMERICHOST | NI_NUMERICSERV) == 0)
		lp_info(object, "listen", "%s port %s", host, port);
}

static int listen_address(const char *object, const struct addrinfo *info)
{
	const int fd = socket(info->ai_family, SOCKET_FLAGS, 0);
	const int yes = 1;
	const char *stage = "bind";
	int ret;

	if (fd < 0)
		return listen_error(object, "socket", -errno);
	/* Ports of connections that linger are free; ports somebody listens on are not. */
	(void)setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof(yes));
	ret = bind(fd, info->ai_addr, info->ai_addrlen) < 0 ? -errno : 0;
	if (ret == 0) {
		stage = "listen";
		ret = listen(fd, BACKLOG) < 0 ? -errno : 0;
	}
	if (ret < 0) {
		listen_error(object, stage, ret);
		close(fd);
		return ret;
	}
	log_listening(object, fd);
	return fd;
}

static int listen_all(const char *object, const struct addrinfo *list, int *fds)
{
	int count = 0;

	for (; list && count < LP_LISTEN_MAX; list = list->ai_next) {
		const int fd = listen_address(object, list);

		if (fd < 0) {
			while (count > 0)
				close(fds[--count]);
			return fd;
		}
		fds[count++] = fd;
	}
	return count;
}

int lp_listen_tcp(const char *object, const struct lp_tcp_address *address, int *fds)
{
	const struct addrinfo hints = {.ai_socktype = SOCK_STREAM,
				       .ai_flags = AI_PASSIVE | AI_ADDRCONFIG};
	struct addrinfo *list = NULL;
	int ret;

	ret = getaddrinfo(address->host, address->port, &hints, &list);
	if (ret != 0) {
		lp_error(object, "address", "%s — check host and port", gai_strerror(ret));
		return -EINVAL;
	}
	ret = listen_all(object, list, fds);
	freeaddrinfo(list);
	return ret;
}

/* ---------------------------------------------------------------- Unix */

/* The program that made the socket file has ended. Only a refusal says so: without permission or
 * descriptors nothing is known. */
static bool is_left_over(const struct sockaddr_un *address)
{
	const int fd = socket(AF_UNIX, SOCKET_FLAGS, 0);
	const bool refused = fd >= 0 &&
			     connect(fd, (const struct sockaddr *)address, sizeof(*address)) < 0 &&
			     errno == ECONNREFUSED;

	if (fd >= 0)
		close(fd);
	return refused;
}

static int bind_path(int fd, const struct sockaddr_un *address)
{
	return bind(fd, (const struct sockaddr *)address, sizeof(*address)) < 0 ? -errno : 0;
}

/* Bind; take the place of a socket file whose program is gone. */
static int bind_or_replace(const char *object, int fd, const struct sockaddr_un *address)
{
	struct stat status;
	int ret = bind_path(fd, address);

	if (ret != -EADDRINUSE)
		return ret;
	if (lstat(address->sun_path, &status) == 0 && !S_ISSOCK(status.st_mode))
		return -EEXIST;
	if (!is_left_over(address))
		return ret;
	lp_info(object, "bind", "no daemon answers on this socket file; it is replaced");
	if (unlink(address->sun_path) < 0)
		return -errno;
	return bind_path(fd, address);
}

/* The folder of a default path may not exist yet (/run is empty after a start). */
static void make_folder(const char *path)
{
	char folder[sizeof(((struct sockaddr_un *)NULL)->sun_path)];
	char *slash;

	(void)snprintf(folder, sizeof(folder), "%s", path);
	slash = strrchr(folder, '/');
	if (slash && slash != folder) {
		*slash = '\0';
		(void)mkdir(folder, 0755); /* bind() tells what is wrong, if anything is */
	}
}

static int open_path(const char *object, const struct sockaddr_un *address, mode_t mode)
{
	const int fd = socket(AF_UNIX, SOCKET_FLAGS, 0);
	const char *stage = "bind";
	int ret;

	if (fd < 0)
		return listen_error(object, "socket", -errno);
	ret = bind_or_replace(object, fd, address);
	if (ret == 0) {
		stage = "listen";
		/* Before anybody can connect. */
		ret = chmod(address->sun_path, mode) < 0 || listen(fd, BACKLOG) < 0 ? -errno : 0;
	}
	if (ret < 0) {
		listen_error(object, stage, ret);
		close(fd);
		return ret;
	}
	return fd;
}

int lp_socket_path_check(const char *object, const char *path)
{
	const size_t room = sizeof(((struct sockaddr_un *)NULL)->sun_path);

	if (*path && strlen(path) < room)
		return 0;
	lp_error(object, "parse", "a socket path has 1 to %zu bytes", room - 1);
	return -EINVAL;
}

int lp_listen_unix(const char *object, const char *path, mode_t mode, struct lp_socket_file *file)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	struct stat status;
	int fd = lp_socket_path_check(object, path);

	if (fd < 0)
		return fd;
	memcpy(address.sun_path, path, strlen(path) + 1);
	make_folder(path);
	fd = open_path(object, &address, mode);
	if (fd >= 0 && stat(path, &status) == 0) {
		memcpy(file->path, address.sun_path, sizeof(file->path));
		file->device = status.st_dev;
		file->inode = status.st_ino;
		lp_info(object, "listen", "ready");
	}
	return fd;
}

void lp_socket_file_remove(struct lp_socket_file *file)
{
	struct stat status;

	if (*file->path && stat(file->path, &status) == 0 && status.st_dev == file->device &&
	    status.st_ino == file->inode)
		(void)unlink(file->path);
	file->path[0] = '\0';
}
