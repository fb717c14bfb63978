/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/file/reader.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/log.h"
#include "drivers/source/frames.h"
#include "drivers/source/photo.h"

#define FIRST_READ_BYTES ((size_t)256 << 10)

struct lp_file_reader {
	char **paths; /* in order */
	size_t path_count, next_path;
	enum lp_encoding wanted;
	uint32_t raw_width_px, raw_height_px;

	/* The file being read. */
	int fd;		  /* -1: none */
	char object[512]; /* its name in messages */
	size_t picture_count;
	enum lp_encoding encoding;
	bool at_end;
	uint8_t *buffer; /* [first, filled) is read and not yet consumed */
	size_t capacity, first, filled;
	bool told_of_rest, told_of_orientation; /* of a photo */
	float f_number; /* of the first photo that says it; 0: none has yet */
};

static void name_object(struct lp_file_reader *reader, const char *path)
{
	(void)snprintf(reader->object, sizeof(reader->object), "file: %s", path);
}

static int read_error(const struct lp_file_reader *reader, const char *stage, int ret)
{
	lp_error(reader->object, stage, "%s%s", lp_strerror(ret),
		 ret == -EACCES	  ? " — may this user read it?"
		 : ret == -ENOENT ? " — check the path"
				  : "");
	return ret;
}

/* ---------------------------------------------------------------- which files */

static int add_path(struct lp_file_reader *reader, const char *folder, const char *name)
{
	char **paths = realloc(reader->paths, (reader->path_count + 1) * sizeof(*paths));
	char *path = NULL;

	if (!paths)
		return -ENOMEM;
	reader->paths = paths;
	if (asprintf(&path, "%s%s%s", folder, *folder ? "/" : "", name) < 0)
		return -ENOMEM;
	paths[reader->path_count++] = path;
	return 0;
}

/* In the order of their numbers: IMG_2 before IMG_10. Files of other kinds (notes, licences) may
 * lie in the folder; they are counted aloud. */
static int add_folder(struct lp_file_reader *reader, const char *folder)
{
	struct dirent **entries;
	const int count = scandir(folder, &entries, NULL, versionsort);
	int ignored = 0, ret = 0;

	if (count < 0)
		return read_error(reader, "list", -errno);
	for (int i = 0; i < count; i++) {
		const char *name = entries[i]->d_name;

		if (name[0] == '.')
			continue;
		if (lp_encoding_of(name, NULL, 0) == LP_ENCODING_UNKNOWN)
			ignored++;
		else if (ret == 0)
			ret = add_path(reader, folder, name);
	}
	for (int i = 0; i < count; i++)
		free(entries[i]);
	free((void *)entries);
	if (ret < 0)
		return ret;
	if (ignored)
		lp_info(reader->object, "list",
			"%d files are left out: their names are not those of pictures", ignored);
	if (reader->path_count == 0) {
		lp_error(reader->object, "list",
			 "no picture in this folder (known: .jpg .jpeg .mjpg .mjpeg "
			 ".yuyv .nv12 .grey .pfm)");
		return -ENOENT;
	}
	return 0;
}

/* ---------------------------------------------------------------- one file */

static void close_file(struct lp_file_reader *reader)
{
	if (reader->fd >= 0)
		close(reader->fd);
	reader->fd = -1;
}

/* Room behind `filled`: as much again as is there already, so that rescanning stays linear. */
static int make_room(struct lp_file_reader *reader)
{
	const size_t used = reader->filled - reader->first;
	const size_t wanted = 2 * used + FIRST_READ_BYTES;
	uint8_t *buffer;

	if (reader->first > 0) {
		memmove(reader->buffer, reader->buffer + reader->first, used);
		reader->first = 0;
		reader->filled = used;
	}
	if (reader->capacity >= wanted)
		return 0;
	buffer = realloc(reader->buffer, wanted);
	if (!buffer)
		return -ENOMEM;
	reader->buffer = buffer;
	reader->capacity = wanted;
	return 0;
}

static int read_more(struct lp_file_reader *reader)
{
	ssize_t got;
	int ret = make_room(reader);

	if (ret < 0)
		return ret;
	do {
		got = read(reader->fd, reader->buffer + reader->filled,
			   reader->capacity - reader->filled);
	} while (got < 0 && errno == EINTR);
	if (got < 0)
		return -errno;
	reader->filled += (size_t)got;
	reader->at_end = got == 0;
	return 0;
}

static bool encoding_is_raw(enum lp_encoding encoding)
{
	return encoding == LP_ENCODING_YUYV || encoding == LP_ENCODING_NV12 ||
	       encoding == LP_ENCODING_GREY;
}

static int find_encoding(struct lp_file_reader *reader, const char *path)
{
	reader->encoding = reader->wanted;
	if (reader->encoding == LP_ENCODING_UNKNOWN)
		reader->encoding = lp_encoding_of(path, reader->buffer, reader->filled);
	if (reader->encoding == LP_ENCODING_UNKNOWN) {
		lp_error(reader->object, "open",
			 "neither the name nor the first bytes tell the format — give "
			 "?format=jpeg|mjpeg|yuyv|nv12|grey|pfm");
		return -EBADMSG;
	}
	if (encoding_is_raw(reader->encoding) && reader->raw_width_px == 0) {
		lp_error(reader->object, "open",
			 "raw pixels do not contain their size — give ?size=WxH");
		return -EINVAL;
	}
	return 0;
}

/* Open paths[next_path], read its first bytes, and see what it is. */
static int open_file(struct lp_file_reader *reader)
{
	const char *path = reader->paths[reader->next_path++];
	struct stat status;
	int ret;

	name_object(reader, path);
	reader->first = reader->filled = reader->picture_count = 0;
	reader->at_end = false;
	/* Non-blocking: the other end of a pipe must not hold us here; it is refused below. */
	reader->fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
	if (reader->fd < 0)
		return read_error(reader, "open", -errno);
	ret = fstat(reader->fd, &status) < 0 ? -errno : 0;
	if (ret == 0 && !S_ISREG(status.st_mode))
		ret = S_ISDIR(status.st_mode) ? -EISDIR : -ESPIPE;
	if (ret == 0)
		ret = read_more(reader);
	if (ret < 0)
		read_error(reader, "read", ret);
	else
		ret = find_encoding(reader, path);
	if (ret < 0)
		close_file(reader);
	return ret;
}

/* ---------------------------------------------------------------- one picture */

/*
 * What the photo says of itself. Its exposure is told relative to ISO 100, and to the aperture of
 * the first photo. Orientation is told, and not obeyed: a camera file is of the pixels as they are
 * stored, however the camera was held.
 */
static void fill_photo(struct lp_file_reader *reader, struct lp_frame *frame)
{
	const struct lp_photo photo = lp_photo_read(frame->data, frame->size_bytes);

	frame->crop = photo.crop;
	frame->exposure_us = photo.exposure_us;
	if (!isnan(photo.exposure_us) && photo.iso > 0)
		frame->gain = (float)photo.iso / 100.0F;
	if (!isnan(photo.exposure_us) && !isnan(photo.f_number)) {
		if (reader->f_number == 0.0F)
			reader->f_number = photo.f_number;
		const float ratio = reader->f_number / photo.f_number;

		frame->gain = (isnan(frame->gain) ? 1.0F : frame->gain) * ratio * ratio;
	}
	if (photo.orientation > 1 && !reader->told_of_orientation) {
		reader->told_of_orientation = true;
		lp_warning(reader->object, "read",
			   "orientation %d is not obeyed: pixels count as they are stored",
			   photo.orientation);
	}
}

static int fill_frame(struct lp_file_reader *reader, const struct lp_picture *picture,
		      struct lp_owned_frame *owned)
{
	int ret = lp_owned_frame_reserve(owned, picture->frame_bytes);

	if (ret < 0)
		return ret;
	owned->frame.brightest =
		lp_picture_copy(picture, reader->buffer + reader->first, owned->buffer);
	owned->frame.format = picture->format;
	owned->frame.width_px = picture->width_px;
	owned->frame.height_px = picture->height_px;
	owned->frame.stride_bytes = picture->stride_bytes;
	owned->frame.size_bytes = picture->frame_bytes;
	if (picture->corrupt) {
		owned->frame.flags |= LP_FRAME_CORRUPT;
		lp_error(reader->object, "read", "a picture is cut off or damaged; it is not used");
	} else if (picture->format == LP_FORMAT_MJPEG) {
		owned->frame.data = owned->buffer;
		fill_photo(reader, &owned->frame);
	}
	if (picture->skip_bytes)
		lp_warning(reader->object, "read",
			   "%zu bytes that belong to no picture are skipped", picture->skip_bytes);
	reader->first += picture->skip_bytes + picture->encoded_bytes;
	reader->picture_count++;
	return 1;
}

int lp_file_reader_files(const struct lp_file_reader *reader)
{
	return (int)reader->path_count;
}

static int at_end_of_file(const struct lp_file_reader *reader)
{
	if (reader->picture_count > 0)
		return 0;
	lp_error(reader->object, "read",
		 "no picture in it — is it empty, damaged, or of another kind?");
	return -EBADMSG;
}

/* A photo is its first picture. Phones append others: previews, gain maps, depths, a movie. */
static bool is_read(struct lp_file_reader *reader)
{
	if (reader->encoding != LP_ENCODING_JPEG || reader->picture_count == 0)
		return false;
	if (!reader->told_of_rest && reader->filled > reader->first)
		lp_info(reader->object, "read",
			"the first picture counts; what follows it in the file is left out — a "
			"stream of pictures is named .mjpg, or read with ?format=mjpeg");
	reader->told_of_rest |= reader->filled > reader->first;
	return true;
}

/* The next picture of the open file: 1, 0 at its end, or negative. */
static int next_in_file(struct lp_file_reader *reader, struct lp_owned_frame *owned)
{
	struct lp_picture picture;
	int ret;

	if (is_read(reader))
		return 0;
	for (;;) {
		ret = lp_picture_next(reader->encoding, reader->raw_width_px, reader->raw_height_px,
				      reader->buffer + reader->first,
				      reader->filled - reader->first, reader->at_end, &picture);
		if (ret == 1)
			return fill_frame(reader, &picture, owned);
		if (ret == -ENODATA)
			return at_end_of_file(reader);
		if (ret < 0) {
			lp_error(reader->object, "read",
				 "not a picture of its kind — is it damaged?");
			return ret;
		}
		reader->first += picture.skip_bytes;
		ret = read_more(reader);
		if (ret < 0)
			return read_error(reader, "read", ret);
	}
}

int lp_file_reader_next(struct lp_file_reader *reader, struct lp_owned_frame *frame)
{
	int ret;

	for (;;) {
		if (reader->fd < 0) {
			if (reader->next_path == reader->path_count) {
				reader->next_path = 0;
				return 0;
			}
			ret = open_file(reader);
			if (ret < 0)
				return ret;
		}
		ret = next_in_file(reader, frame);
		if (ret != 1)
			close_file(reader);
		if (ret != 0)
			return ret;
	}
}

int lp_file_reader_create(const char *path, enum lp_encoding encoding, uint32_t raw_width_px,
			  uint32_t raw_height_px, struct lp_file_reader **reader)
{
	struct lp_file_reader *self = calloc(1, sizeof(*self));
	struct stat status;
	int ret;

	if (!self)
		return -ENOMEM;
	self->fd = -1;
	self->wanted = encoding;
	self->raw_width_px = raw_width_px;
	self->raw_height_px = raw_height_px;
	name_object(self, path);
	if (stat(path, &status) < 0)
		ret = read_error(self, "open", -errno);
	else if (S_ISDIR(status.st_mode))
		ret = add_folder(self, path);
	else
		ret = add_path(self, "", path);
	if (ret == 0)
		ret = open_file(self);
	if (ret < 0) {
		lp_file_reader_destroy(self);
		return ret;
	}
	*reader = self;
	return 0;
}

void lp_file_reader_destroy(struct lp_file_reader *reader)
{
	if (!reader)
		return;
	close_file(reader);
	for (size_t i = 0; i < reader->path_count; i++)
		free(reader->paths[i]);
	free((void *)reader->paths);
	free(reader->buffer);
	free(reader);
}
