/* SPDX-License-Identifier: Apache-2.0 */
/* Listening sockets, with errors that say what to do. */
#ifndef LP_PUBLISHER_LISTEN_H
#define LP_PUBLISHER_LISTEN_H

#include <stddef.h>
#include <sys/types.h>

#define LP_LISTEN_MAX 4 /* addresses of one host name */

/*
 * Listen on every address of HOST:PORT (IPv6 in brackets). Fills fds[LP_LISTEN_MAX] and returns how
 * many, or -errno, logged under `object`: -EADDRINUSE when another program has the port.
 */
int lp_listen_tcp(const char *object, const char *address, int *fds);

/* The socket file that is ours to remove. */
struct lp_socket_file {
	char path[108]; /* "": none */
	dev_t device;
	ino_t inode;
};

/*
 * Listen on a Unix socket with these permission bits. A socket file that nobody answers on is
 * replaced; one where a program answers is -EADDRINUSE; a file of another kind is left alone
 * (-EEXIST). A missing folder is made. Returns the descriptor or -errno, logged under `object`.
 */
int lp_listen_unix(const char *object, const char *path, mode_t mode, struct lp_socket_file *file);

/* Remove the file unless another program has replaced it meanwhile. */
void lp_socket_file_remove(struct lp_socket_file *file);

#endif
