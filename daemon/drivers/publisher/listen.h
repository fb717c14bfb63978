/* SPDX-License-Identifier: Apache-2.0 */
/* Listening sockets, with errors that say what to do. */
#ifndef LP_PUBLISHER_LISTEN_H
#define LP_PUBLISHER_LISTEN_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#define LP_LISTEN_MAX 4 /* addresses of one host name */

#define LP_HOST_BYTES 256

struct lp_tcp_address {
	char host[LP_HOST_BYTES]; /* name or number; IPv6 without its brackets */
	char port[8];
};

/* HOST:PORT, IPv6 in brackets. -EINVAL, logged under `object`. The name is not looked up. */
int lp_tcp_address_parse(const char *object, const char *text, struct lp_tcp_address *address);

/*
 * Whether this address may be opened without encryption: one of this machine alone (127.0.0.0/8,
 * ::1, localhost), or `insecure_lan`, with a warning. 0: of this
 * machine alone. 1: open. -EACCES, logged under `object`. The name is not looked up: one that is
 * not localhost counts as the network.
 */
int lp_tcp_address_check_open(const char *object, const struct lp_tcp_address *address,
			      bool insecure_lan);

bool lp_tcp_address_is_loopback(const struct lp_tcp_address *address);

/* A path that a Unix socket can have. -EINVAL, logged under `object`. */
int lp_socket_path_check(const char *object, const char *path);

/*
 * Listen on every address of a host. Fills fds[LP_LISTEN_MAX] and returns how many, or -errno,
 * logged under `object`: -EADDRINUSE when another program has the port.
 */
int lp_listen_tcp(const char *object, const struct lp_tcp_address *address, int *fds);

/* The socket file that is ours to remove. */
struct lp_socket_file {
	char path[108]; /* "": none */
	dev_t device;
	ino_t inode;
};

/*
 * Listen on a Unix socket with these permission bits. A socket file on which connecting is refused
 * is left over from a program that has ended, and is replaced; any other answer, or none that can
 * be had, is -EADDRINUSE; a file of another kind is left alone (-EEXIST). A missing folder is made.
 * Returns the descriptor or -errno, logged under `object`.
 */
int lp_listen_unix(const char *object, const char *path, mode_t mode, struct lp_socket_file *file);

/* Remove the file unless another program has replaced it meanwhile. */
void lp_socket_file_remove(struct lp_socket_file *file);

#endif
