/* SPDX-License-Identifier: Apache-2.0 */
#include "streaming.h"
#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <linux/usb/video.h>
#include "bytes.h"
#include "negotiation.h"

enum { HEADER_BYTES = 12, NUDGE_NS = 5000000, IDLE_NS = 20000000 };

#define NS_PER_S 1000000000LL

struct streaming {
	struct gadget *gadget;
	struct controls *controls;
	struct pictures *pictures;
	struct faults *faults;
	struct gadget_buffer *buffer;
	struct streaming_counts counts;
	struct agreement probe; /* of the control thread alone */

	pthread_t thread;
	pthread_mutex_t lock; /* of all below */
	pthread_cond_t changed;
	struct agreement committed;
	unsigned order;	 /* raised by every commit, reset and stop */
	unsigned obeyed; /* the order that the thread works by */
	bool on, quit;
};

/* One stream, from a commit to the next order; only the thread sees it. */
struct run {
	unsigned order;
	enum camera_format format;
	const struct camera_size *size;
	int64_t interval_ns;
	int64_t due_ns;
	uint8_t frame_id; /* toggles with every frame */
	bool complained;
};

static int64_t now_ns(void)
{
	struct timespec t;

	clock_gettime(CLOCK_MONOTONIC, &t);
	return t.tv_sec * NS_PER_S + t.tv_nsec;
}

static void sleep_until(int64_t t_ns)
{
	struct timespec t = {t_ns / NS_PER_S, t_ns % NS_PER_S};

	clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
}

static bool is_probe_or_commit(const struct usb_ctrlrequest *request)
{
	int selector = request->wValue >> 8;

	return selector == UVC_VS_PROBE_CONTROL || selector == UVC_VS_COMMIT_CONTROL;
}

int streaming_get(struct streaming *streaming, const struct usb_ctrlrequest *request, uint8_t *data)
{
	static const uint8_t nothing_asked[PROBE_BYTES];
	struct agreement agreement = streaming->probe;

	if (!is_probe_or_commit(request))
		return -EPIPE;
	switch (request->bRequest) {
	case UVC_GET_INFO:
		data[0] = UVC_CONTROL_CAP_GET | UVC_CONTROL_CAP_SET;
		return 1;
	case UVC_GET_LEN:
		put16(data, PROBE_BYTES);
		return 2;
	case UVC_GET_DEF:
		agreement = negotiate(nothing_asked);
		break;
	case UVC_GET_CUR:
	case UVC_GET_MIN:
	case UVC_GET_MAX:
		break;
	default:
		return -EPIPE;
	}
	put_probe(data, &agreement);
	return PROBE_BYTES;
}

/* Makes the thread notice a change: it may be waiting in the kernel, for the host to read. */
static void give_order(struct streaming *streaming)
{
	streaming->order++;
	pthread_cond_broadcast(&streaming->changed);
	while (streaming->obeyed != streaming->order) {
		struct timespec until;

		pthread_kill(streaming->thread, SIGUSR1);
		clock_gettime(CLOCK_REALTIME, &until);
		until.tv_nsec += NUDGE_NS;
		until.tv_sec += until.tv_nsec / NS_PER_S;
		until.tv_nsec %= NS_PER_S;
		pthread_cond_timedwait(&streaming->changed, &streaming->lock, &until);
	}
}

void streaming_reset(struct streaming *streaming)
{
	pthread_mutex_lock(&streaming->lock);
	if (streaming->on) {
		streaming->on = false;
		give_order(streaming);
	}
	pthread_mutex_unlock(&streaming->lock);
}

/* The old stream ends before the commit is acknowledged: no frame of it leaks into the new one. */
int streaming_may_set(struct streaming *streaming, const struct usb_ctrlrequest *request)
{
	if (!is_probe_or_commit(request) || request->wLength < 26 || request->wLength > PROBE_BYTES)
		return -EPIPE;
	if (request->wValue >> 8 == UVC_VS_COMMIT_CONTROL)
		streaming_reset(streaming);
	return 0;
}

void streaming_set(struct streaming *streaming, const struct usb_ctrlrequest *request,
		   const uint8_t *data, size_t size_bytes)
{
	if (size_bytes < 8)
		return;
	streaming->probe = negotiate(data);
	if (fault_is_on(streaming->faults, FAULT_OTHER_SIZE))
		streaming->probe.size_index =
			(uint8_t)camera_size_count(streaming->probe.format_index - 1);
	if (request->wValue >> 8 != UVC_VS_COMMIT_CONTROL)
		return;
	pthread_mutex_lock(&streaming->lock);
	streaming->committed = streaming->probe;
	streaming->on = true;
	give_order(streaming);
	pthread_mutex_unlock(&streaming->lock);
}

/* --- frames, on the thread --- */

static bool ordered_otherwise(struct streaming *streaming, const struct run *run)
{
	bool changed;

	pthread_mutex_lock(&streaming->lock);
	changed = streaming->order != run->order;
	pthread_mutex_unlock(&streaming->lock);
	return changed;
}

/* Waits for a stream to run; false: the thread shall end. */
static bool next_run(struct streaming *streaming, struct run *run)
{
	bool quit;

	pthread_mutex_lock(&streaming->lock);
	for (;;) {
		streaming->obeyed = streaming->order;
		pthread_cond_broadcast(&streaming->changed);
		if (streaming->quit || streaming->on)
			break;
		pthread_cond_wait(&streaming->changed, &streaming->lock);
	}
	quit = streaming->quit;
	if (!quit) {
		const struct agreement *agreement = &streaming->committed;

		*run = (struct run){
			.order = streaming->order,
			.format = agreement->format_index - 1,
			.size = agreed_size(agreement),
			.interval_ns = agreement->interval * 100LL,
			.due_ns = now_ns() + agreement->interval * 100LL,
			.frame_id = run->frame_id,
		};
	}
	pthread_mutex_unlock(&streaming->lock);
	return !quit;
}

/* Payload header with the picture's time and the device's clock (UVC 1.1, 2.4.3.3). */
static void put_header(uint8_t *data, uint8_t flags, int64_t picture_ns)
{
	int64_t now = now_ns();
	uint8_t *at = put8(data, HEADER_BYTES);

	at = put8(at, flags | UVC_STREAM_EOH | UVC_STREAM_PTS | UVC_STREAM_SCR);
	at = put32(at, (uint32_t)(picture_ns / 1000));
	at = put32(at, (uint32_t)(now / 1000));
	put16(at, (uint16_t)(now / 1000000 & 0x7ff)); /* number of the USB frame */
}

static int send_picture(struct streaming *streaming, const struct run *run,
			const struct picture *picture, uint8_t flags)
{
	uint8_t *data = gadget_data(streaming->buffer);
	int64_t picture_ns = now_ns();
	size_t done = 0;

	do {
		size_t part = picture->size_bytes - done;
		uint8_t last = UVC_STREAM_EOF;
		int ret;

		if (part > CAMERA_PAYLOAD_BYTES - HEADER_BYTES) {
			part = CAMERA_PAYLOAD_BYTES - HEADER_BYTES;
			last = 0;
		}
		put_header(data, flags | last | run->frame_id, picture_ns);
		if (part)
			memcpy(data + HEADER_BYTES, picture->data + done, part);
		ret = gadget_write(streaming->gadget, streaming->buffer, HEADER_BYTES + part);
		if (ret < 0)
			return ret;
		done += part;
	} while (done < picture->size_bytes);
	return 0;
}

static int send_garbage(struct streaming *streaming, const struct run *run, size_t size_bytes)
{
	uint8_t *noise = malloc(size_bytes);
	struct picture picture = {noise, size_bytes};
	uint32_t state = 1;
	int ret;

	if (!noise)
		return -ENOMEM;
	for (size_t i = 0; i < size_bytes; i++) {
		state = state * 1664525 + 1013904223;
		noise[i] = (uint8_t)(state >> 24);
	}
	ret = send_picture(streaming, run, &picture, 0);
	free(noise);
	return ret;
}

/* The smallest offered size other than the agreed one. */
static const struct camera_size *other_size(const struct run *run)
{
	int last = camera_size_count(run->format) - 1;
	const struct camera_size *sizes = camera_streams[run->format].sizes;

	return run->size == &sizes[last] ? &sizes[0] : &sizes[last];
}

/* One frame as faults command it; 1 when it was spoiled. */
static int send_frame(struct streaming *streaming, const struct run *run,
		      const struct settings *settings)
{
	struct faults *faults = streaming->faults;
	bool wrong_size = fault_take(faults, FAULT_WRONG_SIZE);
	struct picture picture;
	int ret = pictures_take(streaming->pictures, run->format,
				wrong_size ? other_size(run) : run->size, settings, &picture);

	if (ret < 0)
		return ret;
	if (fault_take(faults, FAULT_GARBAGE))
		ret = send_garbage(streaming, run, picture.size_bytes);
	else if (fault_take(faults, FAULT_OVERLONG))
		ret = send_garbage(streaming, run, 2 * picture.size_bytes);
	else if (fault_take(faults, FAULT_ERROR_BIT))
		ret = send_picture(streaming, run, &picture, UVC_STREAM_ERR);
	else if (fault_take(faults, FAULT_EMPTY))
		ret = send_picture(streaming, run, &(struct picture){0}, 0);
	else if (fault_take(faults, FAULT_TRUNCATED))
		ret = send_picture(streaming, run,
				   &(struct picture){picture.data, picture.size_bytes / 2}, 0);
	else
		return send_picture(streaming, run, &picture, 0) ?: wrong_size;
	return ret ?: 1;
}

/* Keeps the frame rate. Frames whose time has passed while the host did not read are lost. */
static void wait_for_turn(struct streaming *streaming, struct run *run)
{
	int64_t late_ns = now_ns() - run->due_ns;

	if (late_ns >= run->interval_ns) {
		int64_t lost = late_ns / run->interval_ns;

		atomic_fetch_add(&streaming->counts.overrun, (unsigned)lost);
		run->due_ns += lost * run->interval_ns;
	}
	if (!streaming->pictures->paced)
		sleep_until(run->due_ns);
	run->due_ns += run->interval_ns;
}

static bool is_silent(struct streaming *streaming)
{
	return fault_is_on(streaming->faults, FAULT_SILENT) ||
	       fault_is_on(streaming->faults, FAULT_HANG);
}

static void one_frame(struct streaming *streaming, struct run *run)
{
	struct settings settings;
	int ret;

	wait_for_turn(streaming, run);
	if (is_silent(streaming)) {
		sleep_until(now_ns() + IDLE_NS);
		run->due_ns = now_ns();
		return;
	}
	if (fault_take(streaming->faults, FAULT_HALT))
		gadget_halt(streaming->gadget);
	settings = controls_next_frame(streaming->controls);
	run->frame_id ^= UVC_STREAM_FID;
	ret = send_frame(streaming, run, &settings);
	if (ret == -ENOENT && !run->complained) {
		fprintf(stderr, "uvc_camera: no %s picture of %dx%d\n",
			camera_streams[run->format].name, run->size->width_px,
			run->size->height_px);
		run->complained = true;
	}
	if (ret < 0) {
		/* Interrupted, unplugged, reset, or no such picture: not a busy loop. */
		atomic_fetch_add(&streaming->counts.broken, 1);
		sleep_until(now_ns() + IDLE_NS);
		return;
	}
	atomic_fetch_add(ret ? &streaming->counts.spoiled : &streaming->counts.sent, 1);
}

static void *stream_main(void *argument)
{
	struct streaming *streaming = argument;
	struct run run = {0};

	while (next_run(streaming, &run))
		while (!ordered_otherwise(streaming, &run))
			one_frame(streaming, &run);
	return NULL;
}

/* --- life --- */

struct streaming *streaming_create(struct gadget *gadget, struct controls *controls,
				   struct pictures *pictures, struct faults *faults)
{
	static const uint8_t nothing_asked[PROBE_BYTES];
	struct streaming *streaming = calloc(1, sizeof(*streaming));

	if (!streaming)
		return NULL;
	streaming->buffer = gadget_buffer_create(CAMERA_PAYLOAD_BYTES);
	if (!streaming->buffer) {
		free(streaming);
		return NULL;
	}
	streaming->gadget = gadget;
	streaming->controls = controls;
	streaming->pictures = pictures;
	streaming->faults = faults;
	streaming->probe = negotiate(nothing_asked);
	pthread_mutex_init(&streaming->lock, NULL);
	pthread_cond_init(&streaming->changed, NULL);
	return streaming;
}

void streaming_destroy(struct streaming *streaming)
{
	if (!streaming)
		return;
	pthread_cond_destroy(&streaming->changed);
	pthread_mutex_destroy(&streaming->lock);
	free(streaming->buffer);
	free(streaming);
}

int streaming_start(struct streaming *streaming)
{
	streaming->on = streaming->quit = false;
	return -pthread_create(&streaming->thread, NULL, stream_main, streaming);
}

void streaming_stop(struct streaming *streaming)
{
	pthread_mutex_lock(&streaming->lock);
	streaming->quit = true;
	give_order(streaming);
	pthread_mutex_unlock(&streaming->lock);
	pthread_join(streaming->thread, NULL);
}

const struct streaming_counts *streaming_counts(const struct streaming *streaming)
{
	return &streaming->counts;
}
