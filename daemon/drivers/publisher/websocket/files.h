/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The files of one folder, for the HTTP server: regular files below it, and nothing that a symbolic
 * link leads to. Whatever lies in the folder, opening takes no time.
 */
#ifndef LP_WEBSOCKET_FILES_H
#define LP_WEBSOCKET_FILES_H

#include <libwebsockets.h>
#include <stdbool.h>

struct lp_files {
	struct lws_plat_file_ops ops; /* for lws_set_fops(); stays at its address */
	const char *root;
	/* So many bytes of a file are read for `reader`. False: no more for it. */
	bool (*count)(void *reader, size_t size_bytes);
	void *reader; /* who asks for the file that is opened next */
};

/* `root` is borrowed. It is opened anew for each file: a page may be built again meanwhile. */
void lp_files_init(struct lp_files *files, const char *root,
		   bool (*count)(void *reader, size_t size_bytes));

/* Where they appear: at "/", index.html first. */
void lp_files_mount(struct lws_http_mount *mount);

/* Open a regular file, or a folder, by its path below `root`. A symbolic link anywhere below, "..",
 * a device, a FIFO and a socket: -ENOENT. A descriptor that does not block, or -errno. */
int lp_files_open(const char *root, const char *path);

#endif
