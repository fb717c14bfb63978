/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/websocket/files.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/macros.h"

#define NAME_BYTES 256
/* What the mount names, so that paths arrive as it, a slash, and the rest. */
#define ORIGIN "."

/* ---------------------------------------------------------------- which files */

static bool is_served(const struct stat *status)
{
	return S_ISREG(status->st_mode) || S_ISDIR(status->st_mode);
}

/* One name in a folder. Looked at before it is opened, because opening a device may do something;
 * and after, because it may be another by then. */
static int open_name(int folder, const char *name)
{
	struct stat status;
	int fd;

	if (fstatat(folder, name, &status, AT_SYMLINK_NOFOLLOW) < 0)
		return -errno;
	if (!is_served(&status))
		return -ENOENT;
	fd = openat(folder, name, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW | O_NOCTTY);
	if (fd < 0)
		return -errno;
	if (fstat(fd, &status) < 0 || !is_served(&status)) {
		close(fd);
		return -ENOENT;
	}
	return fd;
}

/* The next name of a path; steps over it. 0: none is left. -ENOENT: it leaves the folder, or is too
 * long. */
static int next_name(const char **path, char name[NAME_BYTES])
{
	size_t length;

	*path += strspn(*path, "/");
	length = strcspn(*path, "/");
	if (length >= NAME_BYTES)
		return -ENOENT;
	memcpy(name, *path, length);
	name[length] = '\0';
	*path += length;
	return strcmp(name, "..") == 0 ? -ENOENT : length > 0;
}

int lp_files_open(const char *root, const char *path)
{
	char name[NAME_BYTES];
	int fd = open(root, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	int more;

	if (fd < 0)
		return -errno;
	while ((more = next_name(&path, name)) > 0) {
		const int next = open_name(fd, name);

		close(fd);
		if (next < 0)
			return next;
		fd = next;
	}
	if (more < 0)
		close(fd);
	return more < 0 ? more : fd;
}

/* ---------------------------------------------------------------- libwebsockets' side */

static lws_fop_fd_t on_open(const struct lws_plat_file_ops *ops, const char *filename,
			    const char *rest, lws_fop_flags_t *flags)
{
	const struct lp_files *self = LP_CONTAINER_OF(ops, struct lp_files, ops);
	lws_fop_fd_t file;
	struct stat status;
	int fd;

	(void)rest;
	if (strncmp(filename, ORIGIN "/", strlen(ORIGIN "/")) != 0)
		return NULL;
	fd = lp_files_open(self->root, filename + strlen(ORIGIN "/"));
	file = fd < 0 ? NULL : calloc(1, sizeof(*file));
	if (!file || fstat(fd, &status) < 0) {
		if (fd >= 0)
			close(fd);
		free(file);
		return NULL;
	}
	*file = (struct lws_fop_fd){.fd = fd,
				    .fops = ops,
				    .filesystem_priv = self->reader,
				    .len = (lws_filepos_t)status.st_size,
				    .flags = *flags};
	return file;
}

/* Later versions of libwebsockets have one parameter more. */
__attribute__((unused)) static lws_fop_fd_t on_open_later(const struct lws_plat_file_ops *own,
							  const struct lws_plat_file_ops *ops,
							  const char *filename, const char *rest,
							  lws_fop_flags_t *flags)
{
	(void)ops;
	return on_open(own, filename, rest, flags);
}

/* Versions of clang-format disagree about these lines. */
/* clang-format off */
#define OPEN_OF(ops) \
	_Generic((ops).LWS_FOP_OPEN, __typeof__(&on_open) : on_open, default : on_open_later)
/* clang-format on */

static int on_close(lws_fop_fd_t *file)
{
	close((*file)->fd);
	free(*file);
	*file = NULL;
	return 0;
}

static lws_fileofs_t on_seek(lws_fop_fd_t file, lws_fileofs_t offset)
{
	const off_t at = lseek(file->fd, offset, SEEK_CUR);

	if (at >= 0)
		file->pos = (lws_filepos_t)at;
	return at;
}

static int on_read(lws_fop_fd_t file, lws_filepos_t *count, uint8_t *data, lws_filepos_t size)
{
	const struct lp_files *self = LP_CONTAINER_OF(file->fops, struct lp_files, ops);
	const ssize_t got = read(file->fd, data, (size_t)size);

	*count = got > 0 ? (lws_filepos_t)got : 0;
	file->pos += *count;
	return got < 0 || !self->count(file->filesystem_priv, (size_t)got) ? -1 : 0;
}

static int on_write(lws_fop_fd_t file, lws_filepos_t *count, uint8_t *data, lws_filepos_t size)
{
	(void)file, (void)data, (void)size;
	*count = 0;
	return -1; /* files are read only */
}

void lp_files_init(struct lp_files *files, const char *root,
		   bool (*count)(void *reader, size_t size_bytes))
{
	*files = (struct lp_files){.ops = {.LWS_FOP_OPEN = OPEN_OF(files->ops),
					   .LWS_FOP_CLOSE = on_close,
					   .LWS_FOP_SEEK_CUR = on_seek,
					   .LWS_FOP_READ = on_read,
					   .LWS_FOP_WRITE = on_write},
				   .root = root,
				   .count = count};
}

void lp_files_mount(struct lws_http_mount *mount)
{
	static const struct lws_protocol_vhost_options types[] = {
		{&types[1], NULL, ".glb", "model/gltf-binary"},
		{&types[2], NULL, ".hdr", "application/octet-stream"},
		{NULL, NULL, ".webmanifest", "application/manifest+json"},
	};

	*mount = (struct lws_http_mount){
		.mountpoint = "/",
		.mountpoint_len = 1,
		.origin = ORIGIN,
		.def = "index.html",
		.origin_protocol = LWSMPRO_FILE,
		.extra_mimetypes = types,
		.cache_revalidate = 1,
		.cache_reusable = 1,
	};
}
