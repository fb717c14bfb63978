/* SPDX-License-Identifier: Apache-2.0 */
/* Frames made beforehand, by the simulator for instance: several exposures of the same moment. */
#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "pictures.h"

struct file {
	enum camera_format format;
	unsigned width_px, height_px, number;
	double exposure_us;
	uint8_t *data;
	size_t size_bytes;
};

struct folder {
	struct pictures base;
	struct file *files; /* sorted by number */
	size_t count;
	unsigned turn;
};

static int by_number(const void *a, const void *b)
{
	unsigned one = ((const struct file *)a)->number, other = ((const struct file *)b)->number;

	return (one > other) - (one < other);
}

/* 0: `name` says what the file is; -EINVAL: it is no picture. */
static int parse_name(const char *name, struct file *file)
{
	char extension[8];

	if (sscanf(name, "%ux%u_%lfus_%u.%7s", &file->width_px, &file->height_px,
		   &file->exposure_us, &file->number, extension) != 5)
		return -EINVAL;
	for (int i = 0; i < CAMERA_FORMATS; i++) {
		if (strcmp(extension, camera_streams[i].name) == 0) {
			file->format = i;
			return 0;
		}
	}
	return -EINVAL;
}

static int read_file(const char *path, struct file *file)
{
	FILE *stream = fopen(path, "rb");
	int ret = -EIO;
	long size;

	if (!stream)
		return -errno;
	if (fseek(stream, 0, SEEK_END) == 0 && (size = ftell(stream)) > 0) {
		rewind(stream);
		file->size_bytes = (size_t)size;
		file->data = malloc(file->size_bytes);
		if (file->data &&
		    fread(file->data, 1, file->size_bytes, stream) == file->size_bytes)
			ret = 0;
	}
	fclose(stream);
	return ret;
}

static int add_file(struct folder *folder, const char *path, const char *name)
{
	struct file file = {0}, *files;
	char full[4096];
	int ret;

	if (parse_name(name, &file) < 0)
		return 0;
	snprintf(full, sizeof(full), "%s/%s", path, name);
	ret = read_file(full, &file);
	if (ret < 0) {
		fprintf(stderr, "uvc_camera: %s: %s\n", full, strerror(-ret));
		goto err_free_data;
	}
	files = realloc(folder->files, (folder->count + 1) * sizeof(*files));
	if (!files) {
		ret = -ENOMEM;
		goto err_free_data;
	}
	folder->files = files;
	folder->files[folder->count++] = file;
	return 0;

err_free_data:
	free(file.data);
	return ret;
}

/* How far the file is from what is asked for, in stops; INFINITY: not this format or size. */
static double distance(const struct file *file, enum camera_format format,
		       const struct camera_size *size, const struct settings *settings)
{
	if (file->format != format || file->width_px != size->width_px ||
	    file->height_px != size->height_px)
		return INFINITY;
	return fabs(log2(file->exposure_us / (settings->exposure_us * settings->gain)));
}

static int take(struct pictures *pictures, enum camera_format format,
		const struct camera_size *size, const struct settings *settings,
		struct picture *picture)
{
	struct folder *folder = (struct folder *)pictures;
	double best = INFINITY;
	unsigned equal = 0, turn;

	for (size_t i = 0; i < folder->count; i++) {
		double d = distance(&folder->files[i], format, size, settings);

		equal = d < best ? 1 : equal + (d == best);
		best = fmin(best, d);
	}
	if (isinf(best))
		return -ENOENT;
	turn = folder->turn++ % equal;
	for (size_t i = 0; i < folder->count; i++) {
		const struct file *file = &folder->files[i];

		if (distance(file, format, size, settings) == best && turn-- == 0) {
			*picture = (struct picture){file->data, file->size_bytes};
			break;
		}
	}
	return 0;
}

static void destroy(struct pictures *pictures)
{
	struct folder *folder = (struct folder *)pictures;

	for (size_t i = 0; i < folder->count; i++)
		free(folder->files[i].data);
	free(folder->files);
	free(folder);
}

static const struct pictures_ops ops = {.take = take, .destroy = destroy};

struct pictures *pictures_folder_create(const char *path)
{
	struct folder *folder = calloc(1, sizeof(*folder));
	struct dirent *entry;
	DIR *stream;
	int ret = 0;

	if (!folder)
		return NULL;
	folder->base.ops = &ops;
	stream = opendir(path);
	if (!stream) {
		fprintf(stderr, "uvc_camera: %s: %s\n", path, strerror(errno));
		goto err_destroy;
	}
	while (ret == 0 && (entry = readdir(stream)))
		ret = add_file(folder, path, entry->d_name);
	closedir(stream);
	if (ret == 0 && folder->count == 0)
		fprintf(stderr, "uvc_camera: %s: no file WxH_EXPOSUREus_N.{jpg,yuyv,nv12,grey}\n",
			path);
	if (folder->count == 0 || ret < 0)
		goto err_destroy;
	qsort(folder->files, folder->count, sizeof(*folder->files), by_number);
	return &folder->base;

err_destroy:
	destroy(&folder->base);
	return NULL;
}
