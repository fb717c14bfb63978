/* SPDX-License-Identifier: Apache-2.0 */
#include "app/series/series_writer.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/log.h"
#include "base/mailbox.h"
#include "base/pool.h"
#include "include/frame.h"
#include "include/processing.h"

#define WAITING_FRAMES 64 /* more than any source has: none is displaced */

struct item {
	struct lp_frame *frame;
	struct lp_series_shot shot;
};

struct lp_series_writer {
	char *folder;
	int folder_fd;
	FILE *index;
	const char *scheme;
	struct lp_source_caps caps;
	struct lp_pool *items;
	struct lp_mailbox *inbox;
	pthread_t thread;
	bool thread_runs;
	unsigned int written;
	atomic_int error;
};

/* ---------------------------------------------------------------- the index */

/* JSON has no NaN: what is not known is null. */
static void put_number(FILE *out, const char *name, float value)
{
	if (isfinite(value))
		(void)fprintf(out, ", \"%s\": %.9g", name, (double)value);
	else
		(void)fprintf(out, ", \"%s\": null", name);
}

/* null: the camera does not tell. */
static void put_processing(FILE *out, const struct lp_source_caps *caps)
{
	const char *between = "";

	(void)fprintf(out, ", \"processing\": %s", caps->tells_processing ? "[" : "null");
	if (!caps->tells_processing)
		return;
	for (int kind = 0; kind < LP_PROCESSING_KINDS; kind++)
		if (caps->processing_on & LP_PROCESSING_BIT(kind)) {
			(void)fprintf(out, "%s\"%s\"", between, lp_processing_name(kind));
			between = ", ";
		}
	(void)fprintf(out, "]");
}

static void write_camera(const struct lp_series_writer *writer)
{
	const struct lp_source_caps *caps = &writer->caps;

	(void)fprintf(writer->index,
		      "{\"lightprobe_series\": 1, \"software\": \"lightprobed " LP_VERSION "\", "
		      "\"source\": \"%s\", \"exposure_settable\": %s, \"reports_exposure\": %s, "
		      "\"exposure_delay_frames\": %d",
		      writer->scheme, caps->exposure_settable ? "true" : "false",
		      caps->reports_exposure ? "true" : "false", caps->exposure_delay_frames);
	put_number(writer->index, "exposure_min_us", caps->exposure_min_us);
	put_number(writer->index, "exposure_max_us", caps->exposure_max_us);
	put_number(writer->index, "exposure_step_us", caps->exposure_step_us);
	put_processing(writer->index, caps);
	(void)fprintf(writer->index, "}\n");
}

static const struct {
	const char *name, *suffix;
} formats[] = {
	[LP_FORMAT_MJPEG] = {"MJPG", "jpg"},   [LP_FORMAT_YUYV] = {"YUYV", "yuyv"},
	[LP_FORMAT_NV12] = {"NV12", "nv12"},   [LP_FORMAT_GREY] = {"GREY", "grey"},
	[LP_FORMAT_RGB_F32] = {"RGBF", "f32"},
};

static void write_row(const struct lp_series_writer *writer, const char *name,
		      const struct item *item)
{
	const struct lp_frame *frame = item->frame;
	FILE *out = writer->index;

	(void)fprintf(out,
		      "{\"file\": \"%s\", \"format\": \"%s\", \"width_px\": %u, \"height_px\": %u, "
		      "\"stride_bytes\": %u, \"sequence\": %" PRIu64 ", \"t_read_ns\": %" PRId64
		      ", \"t_arrival_ns\": %" PRId64 ", \"corrupt\": %s, \"step\": %d, "
		      "\"t_command_ns\": %" PRId64,
		      name, formats[frame->format].name, frame->width_px, frame->height_px,
		      frame->stride_bytes, frame->sequence, frame->t_read_ns, frame->t_arrival_ns,
		      frame->flags & LP_FRAME_CORRUPT ? "true" : "false", item->shot.step,
		      item->shot.t_command_ns);
	put_number(out, "commanded_us", item->shot.exposure_us);
	put_number(out, "exposure_us", frame->exposure_us);
	put_number(out, "gain", frame->gain);
	(void)fprintf(out, "}\n");
}

/* ---------------------------------------------------------------- the writing thread */

static int write_all(int fd, const uint8_t *data, size_t size_bytes)
{
	while (size_bytes > 0) {
		const ssize_t done = write(fd, data, size_bytes);

		if (done < 0 && errno == EINTR)
			continue;
		if (done < 0)
			return -errno;
		data += done;
		size_bytes -= (size_t)done;
	}
	return 0;
}

static int write_frame(struct lp_series_writer *writer, const struct item *item)
{
	const struct lp_frame *frame = item->frame;
	char name[32];
	int fd, ret;

	(void)snprintf(name, sizeof(name), "%05u.%s", writer->written,
		       formats[frame->format].suffix);
	fd = openat(writer->folder_fd, name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
	if (fd < 0)
		return -errno;
	ret = write_all(fd, frame->data, frame->size_bytes);
	if (close(fd) < 0 && ret == 0)
		ret = -errno;
	if (ret < 0)
		return ret;
	write_row(writer, name, item);
	if (fflush(writer->index) != 0)
		return -errno;
	writer->written++;
	return 0;
}

static void *work(void *argument)
{
	struct lp_series_writer *writer = argument;
	struct item *item;

	write_camera(writer);
	while ((item = lp_mailbox_wait(writer->inbox)) != NULL) {
		int ret = atomic_load(&writer->error);

		if (ret == 0) {
			ret = write_frame(writer, item);
			if (ret < 0)
				lp_error(writer->folder, "write",
					 "%s — the series is not complete; is the disk full?",
					 lp_strerror(ret));
			atomic_store(&writer->error, ret);
		}
		lp_frame_release(item->frame);
		lp_pool_give(writer->items, item);
	}
	return NULL;
}

/* ---------------------------------------------------------------- the rest */

static bool is_empty(DIR *folder)
{
	const struct dirent *entry;

	while ((entry = readdir(folder)) != NULL)
		if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0)
			return false;
	return true;
}

/* 0 or -errno; logged. */
static int open_folder(struct lp_series_writer *writer)
{
	DIR *folder = NULL;
	int fd, ret = 0;

	if (mkdir(writer->folder, 0700) == 0 || errno == EEXIST)
		folder = opendir(writer->folder);
	if (!folder) {
		ret = -errno;
		lp_error(writer->folder, "open", "%s — check --series", lp_strerror(ret));
		return ret;
	}
	if (!is_empty(folder)) {
		lp_error(writer->folder, "open",
			 "the folder is not empty, and nothing is overwritten — name a new one");
		ret = -EEXIST;
		goto close_folder;
	}
	writer->folder_fd = dup(dirfd(folder));
	fd = openat(dirfd(folder), "index.jsonl", O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
	writer->index = fd < 0 ? NULL : fdopen(fd, "w");
	if (writer->folder_fd < 0 || !writer->index) {
		ret = -errno;
		lp_error(writer->folder, "index.jsonl", "%s — check --series", lp_strerror(ret));
		if (fd >= 0 && !writer->index)
			close(fd);
	}
close_folder:
	(void)closedir(folder);
	return ret;
}

static void destroy(struct lp_series_writer *writer)
{
	if (writer->index)
		(void)fclose(writer->index);
	if (writer->folder_fd >= 0)
		close(writer->folder_fd);
	lp_mailbox_destroy(writer->inbox);
	lp_pool_destroy(writer->items);
	free(writer->folder);
	free(writer);
}

int lp_series_writer_create(const char *folder, struct lp_series_writer **writer)
{
	struct lp_series_writer *self = calloc(1, sizeof(*self));
	int ret = -ENOMEM;

	if (!self)
		return -ENOMEM;
	self->folder_fd = -1;
	self->folder = strdup(folder);
	self->inbox = lp_mailbox_create(WAITING_FRAMES);
	/* One at work and one on its way besides those that wait. */
	self->items = lp_pool_create(sizeof(struct item), WAITING_FRAMES + 2, NULL);
	if (self->folder && self->inbox && self->items)
		ret = open_folder(self);
	if (ret < 0) {
		destroy(self);
		return ret;
	}
	*writer = self;
	return 0;
}

int lp_series_writer_start(struct lp_series_writer *writer, const char *scheme,
			   const struct lp_source_caps *caps)
{
	int ret;

	writer->scheme = scheme;
	writer->caps = *caps;
	ret = -pthread_create(&writer->thread, NULL, work, writer);
	if (ret < 0)
		lp_error(writer->folder, "write", "no thread: %s", lp_strerror(ret));
	writer->thread_runs = ret == 0;
	return ret;
}

void lp_series_writer_put(struct lp_series_writer *writer, struct lp_frame *frame,
			  const struct lp_series_shot *shot)
{
	struct item *item = lp_pool_take(writer->items);

	if (!item) {
		lp_frame_release(frame);
		return;
	}
	*item = (struct item){.frame = frame, .shot = *shot};
	item = lp_mailbox_put(writer->inbox, item);
	if (item) {
		lp_frame_release(item->frame);
		lp_pool_give(writer->items, item);
	}
}

int lp_series_writer_error(struct lp_series_writer *writer)
{
	return atomic_load(&writer->error);
}

int lp_series_writer_finish(struct lp_series_writer *writer, bool complete)
{
	int ret;

	lp_mailbox_close(writer->inbox);
	if (writer->thread_runs)
		pthread_join(writer->thread, NULL);
	ret = atomic_load(&writer->error);
	(void)fprintf(writer->index, "{\"frames\": %u, \"complete\": %s}\n", writer->written,
		      complete && ret == 0 ? "true" : "false");
	if (fflush(writer->index) != 0 && ret == 0) {
		ret = -errno;
		lp_error(writer->folder, "index.jsonl", "%s", lp_strerror(ret));
	}
	destroy(writer);
	return ret;
}
