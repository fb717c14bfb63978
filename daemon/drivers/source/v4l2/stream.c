/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/v4l2/stream.h"

#include <errno.h>
#include <linux/videodev2.h>
#include <math.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include "base/clock.h"

/* Those at the worker, one waiting for it, one on its way, and three for the driver to fill. A
 * compressed frame is never held beyond its own turn. */
#define BUFFERS_MJPEG (1 + 5)
#define BUFFERS_RAW (LP_FRAMES_HELD + 5)
#define MAX_BUFFERS 32 /* a driver may insist on more */

/* Of a dequeued buffer there is a frame; a released frame's buffer is free to be queued again. */
enum buffer_state { BUFFER_FREE, BUFFER_QUEUED, BUFFER_DEQUEUED };

struct buffer {
	struct lp_frame frame;
	struct lp_v4l2_stream *stream;
	uint32_t index;
	void *memory;
	size_t length_bytes;
	enum buffer_state state;
};

struct lp_v4l2_stream {
	int fd;
	struct lp_offer_choice choice;
	uint32_t stride_bytes;
	size_t picture_bytes; /* of a complete raw picture; 0: MJPEG */
	uint64_t sequence_base, next_sequence;

	pthread_mutex_t lock; /* of what follows, and of each buffer's state */
	bool on;
	int references; /* the owner, and every dequeued frame */
	int count;
	struct buffer buffers[MAX_BUFFERS];
};

static int call(const struct lp_v4l2_stream *stream, unsigned long request, void *argument)
{
	return ioctl(stream->fd, request, argument) < 0 ? -errno : 0;
}

static void free_stream(struct lp_v4l2_stream *stream)
{
	for (int i = 0; i < stream->count; i++) {
		if (stream->buffers[i].memory)
			munmap(stream->buffers[i].memory, stream->buffers[i].length_bytes);
	}
	close(stream->fd);
	pthread_mutex_destroy(&stream->lock);
	free(stream);
}

/* With the lock held. */
static int queue(struct lp_v4l2_stream *stream, struct buffer *buffer)
{
	struct v4l2_buffer request = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE,
				      .memory = V4L2_MEMORY_MMAP,
				      .index = buffer->index};
	const int ret = call(stream, VIDIOC_QBUF, &request);

	buffer->state = ret == 0 ? BUFFER_QUEUED : BUFFER_FREE;
	return ret;
}

static int queue_all(struct lp_v4l2_stream *stream)
{
	int ret = 0;

	for (int i = 0; i < stream->count && ret == 0; i++) {
		if (stream->buffers[i].state == BUFFER_FREE)
			ret = queue(stream, &stream->buffers[i]);
	}
	return ret;
}

static void drop_reference(struct lp_v4l2_stream *stream)
{
	bool last;

	pthread_mutex_lock(&stream->lock);
	last = --stream->references == 0;
	pthread_mutex_unlock(&stream->lock);
	if (last)
		free_stream(stream);
}

static void release(struct lp_frame *frame)
{
	struct buffer *buffer = (struct buffer *)frame;
	struct lp_v4l2_stream *stream = buffer->stream;

	pthread_mutex_lock(&stream->lock);
	buffer->state = BUFFER_FREE;
	/* While the stream is off its calls may take long: the capture thread does it then. */
	if (stream->on)
		(void)queue(stream, buffer);
	pthread_mutex_unlock(&stream->lock);
	drop_reference(stream);
}

/* ---------------------------------------------------------------- setting up */

static int set_format(struct lp_v4l2_stream *stream, const char **stage)
{
	struct lp_offer_choice *choice = &stream->choice;
	struct v4l2_format format = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};
	struct v4l2_pix_format *pix = &format.fmt.pix;
	uint32_t row_bytes = lp_row_bytes(choice->format, choice->width_px);
	int ret;

	pix->width = choice->width_px;
	pix->height = choice->height_px;
	pix->pixelformat = choice->fourcc;
	pix->field = V4L2_FIELD_NONE;
	*stage = "S_FMT";
	ret = call(stream, VIDIOC_S_FMT, &format);
	if (ret < 0)
		return ret;
	if (pix->width != choice->width_px || pix->height != choice->height_px ||
	    pix->pixelformat != choice->fourcc) {
		*stage = "S_FMT: the driver sets another format or size than it offers";
		return -EPROTO;
	}
	if (choice->format == LP_FORMAT_MJPEG)
		return 0;
	stream->stride_bytes = pix->bytesperline ? pix->bytesperline : row_bytes;
	stream->picture_bytes =
		lp_picture_bytes(choice->format, stream->stride_bytes, choice->height_px);
	if (stream->stride_bytes < row_bytes || pix->sizeimage < stream->picture_bytes) {
		*stage = "S_FMT: the driver's rows or pictures are too short for their size";
		return -EPROTO;
	}
	return 0;
}

/* The rate is a wish: not every driver takes one. What it answers is the rate. */
static void set_rate(struct lp_v4l2_stream *stream)
{
	struct v4l2_streamparm parameters = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};
	struct v4l2_fract *interval = &parameters.parm.capture.timeperframe;

	if (stream->choice.rate_hz > 0) {
		interval->numerator = 100000;
		interval->denominator = (uint32_t)lrintf(stream->choice.rate_hz * 100000);
		if (call(stream, VIDIOC_S_PARM, &parameters) < 0)
			return;
	} else if (call(stream, VIDIOC_G_PARM, &parameters) < 0) {
		return;
	}
	if (interval->numerator && interval->denominator)
		stream->choice.rate_hz = (float)interval->denominator / (float)interval->numerator;
}

static int map_buffer(struct lp_v4l2_stream *stream, uint32_t index, const char **stage)
{
	struct v4l2_buffer request = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE,
				      .memory = V4L2_MEMORY_MMAP,
				      .index = index};
	struct buffer *buffer = &stream->buffers[index];
	void *memory;
	int ret;

	*stage = "QUERYBUF";
	ret = call(stream, VIDIOC_QUERYBUF, &request);
	if (ret < 0)
		return ret;
	if (request.length < stream->picture_bytes) {
		*stage = "QUERYBUF: the driver's buffers are too small for its pictures";
		return -EPROTO;
	}
	*stage = "mmap";
	memory = mmap(NULL, request.length, PROT_READ, MAP_SHARED, stream->fd,
		      (off_t)request.m.offset);
	if (memory == MAP_FAILED)
		return -errno;
	*buffer = (struct buffer){.stream = stream,
				  .index = index,
				  .memory = memory,
				  .length_bytes = request.length};
	return 0;
}

static int map_buffers(struct lp_v4l2_stream *stream, const char **stage)
{
	struct v4l2_requestbuffers request = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE,
					      .memory = V4L2_MEMORY_MMAP,
					      .count = stream->picture_bytes ? BUFFERS_RAW
									     : BUFFERS_MJPEG};
	int ret;

	*stage = "REQBUFS";
	ret = call(stream, VIDIOC_REQBUFS, &request);
	if (ret < 0)
		return ret;
	if (request.count < 2 || request.count > MAX_BUFFERS)
		return -ENOMEM;
	for (uint32_t i = 0; i < request.count && ret == 0; i++) {
		ret = map_buffer(stream, i, stage);
		stream->count += ret == 0;
	}
	return ret;
}

/* With the lock held and the stream off. */
static int turn_on(struct lp_v4l2_stream *stream, const char **stage)
{
	int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
	int ret;

	*stage = "QBUF";
	ret = queue_all(stream);
	if (ret < 0)
		return ret;
	*stage = "STREAMON";
	/* Frames may be released meanwhile, and must not wait for the camera. */
	pthread_mutex_unlock(&stream->lock);
	ret = call(stream, VIDIOC_STREAMON, &type);
	pthread_mutex_lock(&stream->lock);
	if (ret < 0)
		return ret;
	stream->on = true;
	*stage = "QBUF";
	return queue_all(stream);
}

/* With the lock held. The driver has no buffers afterwards. */
static void turn_off(struct lp_v4l2_stream *stream)
{
	int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;

	stream->on = false;
	pthread_mutex_unlock(&stream->lock);
	(void)call(stream, VIDIOC_STREAMOFF, &type);
	pthread_mutex_lock(&stream->lock);
	for (int i = 0; i < stream->count; i++) {
		if (stream->buffers[i].state == BUFFER_QUEUED)
			stream->buffers[i].state = BUFFER_FREE;
	}
}

int lp_v4l2_stream_start(int fd, const struct lp_offer_choice *choice,
			 struct lp_v4l2_stream **stream, const char **stage)
{
	struct lp_v4l2_stream *self = calloc(1, sizeof(*self));
	int ret;

	*stage = "start";
	if (!self) {
		close(fd);
		return -ENOMEM;
	}
	self->fd = fd;
	self->choice = *choice;
	self->references = 1;
	pthread_mutex_init(&self->lock, NULL);
	ret = set_format(self, stage);
	if (ret < 0)
		goto err_free;
	set_rate(self);
	ret = map_buffers(self, stage);
	if (ret < 0)
		goto err_free;
	pthread_mutex_lock(&self->lock);
	ret = turn_on(self, stage);
	pthread_mutex_unlock(&self->lock);
	if (ret < 0)
		goto err_free;
	*stream = self;
	return 0;

err_free:
	free_stream(self);
	return ret;
}

/* ---------------------------------------------------------------- running */

static int64_t time_stamp_ns(const struct v4l2_buffer *buffer)
{
	if ((buffer->flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) != V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC)
		return 0;
	return (int64_t)buffer->timestamp.tv_sec * LP_NS_PER_S +
	       (int64_t)buffer->timestamp.tv_usec * LP_NS_PER_US;
}

/* The driver says so, or the picture is not whole. */
static bool is_corrupt(const struct lp_v4l2_stream *stream, const struct v4l2_buffer *buffer)
{
	return (buffer->flags & V4L2_BUF_FLAG_ERROR) || buffer->bytesused == 0 ||
	       buffer->bytesused < stream->picture_bytes;
}

static void fill_frame(struct lp_v4l2_stream *stream, struct buffer *out,
		       const struct v4l2_buffer *buffer)
{
	const size_t used_bytes = buffer->bytesused;

	out->frame = (struct lp_frame){
		.format = stream->choice.format,
		.width_px = stream->choice.width_px,
		.height_px = stream->choice.height_px,
		.stride_bytes = stream->stride_bytes,
		.data = out->memory,
		.size_bytes = used_bytes < out->length_bytes ? used_bytes : out->length_bytes,
		.sequence = stream->sequence_base + buffer->sequence,
		.t_read_ns = time_stamp_ns(buffer),
		.t_arrival_ns = lp_clock_ns(),
		.exposure_us = NAN,
		.gain = NAN,
		.wheel_deg = NAN,
		.wheel_sigma_deg = NAN,
		.orientation = {NAN, NAN, NAN, NAN},
		.orientation_sigma_deg = NAN,
		.row_time_us = NAN,
		.period_us = NAN,
		.flags = is_corrupt(stream, buffer) ? LP_FRAME_CORRUPT : 0,
		.release = release,
	};
	stream->next_sequence = out->frame.sequence + 1;
}

int lp_v4l2_stream_dequeue(struct lp_v4l2_stream *stream, struct lp_frame **frame)
{
	struct v4l2_buffer buffer = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE,
				     .memory = V4L2_MEMORY_MMAP};
	const int ret = call(stream, VIDIOC_DQBUF, &buffer);
	struct buffer *out;

	if (ret < 0)
		return ret;
	if (buffer.index >= (uint32_t)stream->count)
		return -EPROTO;
	out = &stream->buffers[buffer.index];
	fill_frame(stream, out, &buffer);
	pthread_mutex_lock(&stream->lock);
	out->state = BUFFER_DEQUEUED;
	stream->references++;
	pthread_mutex_unlock(&stream->lock);
	*frame = &out->frame;
	return 0;
}

int lp_v4l2_stream_restart(struct lp_v4l2_stream *stream)
{
	const char *stage;
	int ret;

	pthread_mutex_lock(&stream->lock);
	turn_off(stream);
	stream->sequence_base = stream->next_sequence; /* the driver begins at 0 again */
	ret = turn_on(stream, &stage);
	pthread_mutex_unlock(&stream->lock);
	return ret;
}

int lp_v4l2_stream_queued(struct lp_v4l2_stream *stream)
{
	int queued = 0;

	pthread_mutex_lock(&stream->lock);
	for (int i = 0; i < stream->count; i++)
		queued += stream->buffers[i].state == BUFFER_QUEUED;
	pthread_mutex_unlock(&stream->lock);
	return queued;
}

int lp_v4l2_stream_fd(const struct lp_v4l2_stream *stream)
{
	return stream->fd;
}

float lp_v4l2_stream_rate_hz(const struct lp_v4l2_stream *stream)
{
	return stream->choice.rate_hz;
}

void lp_v4l2_stream_stop(struct lp_v4l2_stream *stream)
{
	struct v4l2_requestbuffers none = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE,
					   .memory = V4L2_MEMORY_MMAP};

	if (!stream)
		return;
	pthread_mutex_lock(&stream->lock);
	turn_off(stream);
	pthread_mutex_unlock(&stream->lock);
	/* The camera is free to be opened again; memory that is still mapped lives on by itself. */
	(void)call(stream, VIDIOC_REQBUFS, &none);
	drop_reference(stream);
}
