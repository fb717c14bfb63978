/* SPDX-License-Identifier: Apache-2.0 */
/* Frames from the simulator's socket (proto/sim.md): the simulator's world behind a real USB
 * camera. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>
#include "bytes.h"
#include "pictures.h"

/* Headers of the simulator's frames (proto/sim.md): what is beyond the first part is skipped. */
enum { HEADER_BYTES = 64, HEADER_MAX_BYTES = 4096 };
enum { RETRY_US = 100000, PICTURE_MAX_BYTES = 64 << 20 };

struct simulator {
	struct pictures base;
	char *path, *query;
	int fd; /* -1: not connected */
	struct settings told;
	uint8_t *data;
	size_t capacity_bytes;
};

static const char *const names[CAMERA_FORMATS] = {"MJPG", "YUYV", "NV12", "GREY"};

static void disconnect(struct simulator *simulator)
{
	if (simulator->fd >= 0)
		close(simulator->fd);
	simulator->fd = -1;
	simulator->told = (struct settings){0};
}

static int say(struct simulator *simulator, const char *line)
{
	size_t size = strlen(line);
	ssize_t sent = send(simulator->fd, line, size, MSG_NOSIGNAL);

	return sent < 0 ? -errno : sent == (ssize_t)size ? 0 : -EIO;
}

static int connect_simulator(struct simulator *simulator)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	char hello[512];
	int ret;

	strncpy(address.sun_path, simulator->path, sizeof(address.sun_path) - 1);
	simulator->fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
	if (simulator->fd < 0)
		return -errno;
	snprintf(hello, sizeof(hello), "hello %s\n", simulator->query);
	ret = connect(simulator->fd, (struct sockaddr *)&address, sizeof(address)) ? -errno : 0;
	if (ret == 0)
		ret = say(simulator, hello);
	if (ret < 0)
		disconnect(simulator);
	return ret;
}

static int tell_exposure(struct simulator *simulator, const struct settings *settings)
{
	char line[64];

	if (settings->exposure_us == simulator->told.exposure_us &&
	    settings->gain == simulator->told.gain)
		return 0;
	simulator->told = *settings;
	snprintf(line, sizeof(line), "exposure %.1f %.4f\n", settings->exposure_us, settings->gain);
	return say(simulator, line);
}

static int read_all(struct simulator *simulator, uint8_t *data, size_t size_bytes)
{
	while (size_bytes) {
		ssize_t got = read(simulator->fd, data, size_bytes);

		if (got < 0)
			return -errno;
		if (got == 0)
			return -ENOTCONN;
		data += got;
		size_bytes -= (size_t)got;
	}
	return 0;
}

static int read_frame(struct simulator *simulator, uint8_t *header, size_t *size_bytes)
{
	uint8_t skipped[HEADER_MAX_BYTES];
	int ret = read_all(simulator, header, HEADER_BYTES);
	size_t header_bytes;

	if (ret < 0)
		return ret;
	header_bytes = get_le(header + 4, 4);
	*size_bytes = get_le(header + 8, 4);
	if (memcmp(header, "LPF1", 4) != 0 || header_bytes < HEADER_BYTES ||
	    header_bytes > HEADER_MAX_BYTES || get_le(header + 12, 4) != 0 ||
	    *size_bytes > PICTURE_MAX_BYTES)
		return -EPROTO;
	ret = read_all(simulator, skipped, header_bytes - HEADER_BYTES);
	if (ret < 0)
		return ret;
	if (*size_bytes > simulator->capacity_bytes) {
		uint8_t *larger = realloc(simulator->data, *size_bytes);

		if (!larger)
			return -ENOMEM;
		simulator->data = larger;
		simulator->capacity_bytes = *size_bytes;
	}
	return read_all(simulator, simulator->data, *size_bytes);
}

static int take(struct pictures *pictures, enum camera_format format,
		const struct camera_size *size, const struct settings *settings,
		struct picture *picture)
{
	struct simulator *simulator = (struct simulator *)pictures;
	uint8_t header[HEADER_BYTES];
	size_t size_bytes = 0;
	int ret = 0;

	if (simulator->fd < 0)
		ret = connect_simulator(simulator);
	if (ret == 0)
		ret = tell_exposure(simulator, settings);
	if (ret == 0)
		ret = read_frame(simulator, header, &size_bytes);
	if (ret < 0) {
		/* A part of a frame is lost with the connection; the next one starts clean. */
		disconnect(simulator);
		return ret;
	}
	if (memcmp(header + 16, names[format], 4) != 0 ||
	    get_le(header + 20, 4) != size->width_px || get_le(header + 24, 4) != size->height_px)
		return -ENOENT;
	*picture = (struct picture){simulator->data, size_bytes};
	return 0;
}

static void destroy(struct pictures *pictures)
{
	struct simulator *simulator = (struct simulator *)pictures;

	disconnect(simulator);
	free(simulator->path);
	free(simulator->data);
	free(simulator);
}

static const struct pictures_ops ops = {.take = take, .destroy = destroy};

struct pictures *pictures_simulator_create(const char *path_and_query)
{
	struct simulator *simulator = calloc(1, sizeof(*simulator));
	char *mark;

	if (!simulator)
		return NULL;
	simulator->base = (struct pictures){.ops = &ops, .paced = true};
	simulator->fd = -1;
	simulator->path = strdup(path_and_query);
	if (!simulator->path) {
		free(simulator);
		return NULL;
	}
	mark = strchr(simulator->path, '?');
	simulator->query = mark ? mark + 1 : "";
	if (mark)
		*mark = 0;
	return &simulator->base;
}
