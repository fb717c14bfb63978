/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Cameras as the kernel's V4L2 shows them, made by the test: the system calls of the v4l2 source
 * end here (the linker's --wrap, tests/tests.mk), and everything above them is the real source.
 * For the kernel's own uvcvideo: tests/kernel.
 */
#ifndef LP_FAKE_V4L2_H
#define LP_FAKE_V4L2_H

#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <unistd.h>

#include "drivers/source/v4l2/nodes.h"

#define FAKE_CAMERAS 2
#define FAKE_BUFFERS 32
#define FAKE_WIDTH_PX 64
#define FAKE_HEIGHT_PX 32
#define FAKE_BYTES (FAKE_WIDTH_PX * FAKE_HEIGHT_PX)
#define FAKE_CONTROLS 18
#define FAKE_DESCRIPTORS 1024

struct fake_control {
	uint32_t id; /* 0: this camera lacks it */
	int32_t value;
	int32_t minimum, maximum, usual; /* maximum 0: 10000 */
	uint32_t flags;			 /* V4L2_CTRL_FLAG_... */
	int error;			 /* errno of writing it */
	bool is_stubborn;		 /* takes what is written, and keeps its own */
};

struct fake_camera {
	bool present;
	bool offers_nothing;	    /* no format that could be used */
	bool any_rate;		    /* from 5 to 120 Hz, instead of 100 Hz alone */
	struct v4l2_fract interval; /* that was set; of any_rate */
	uint16_t product;
	int open_error;	   /* errno of open(); 0: it succeeds */
	int control_error; /* errno of every call about controls; 0: they succeed */
	int opened;	   /* how often */
	int control_calls; /* since this was set to 0 */
	int fd;		   /* of whoever has it open; readable while a buffer is done */
	int streams;	   /* boolean */
	uint32_t sequence;
	int buffer_count;
	bool queued[FAKE_BUFFERS];
	struct v4l2_buffer done[FAKE_BUFFERS];
	int done_count;
	struct fake_control controls[FAKE_CONTROLS];
};

static struct {
	pthread_mutex_t lock;
	int hotplug_fd;
	int resets;
	bool is_dead[FAKE_DESCRIPTORS]; /* descriptors of cameras that were unplugged */
	struct fake_camera cameras[FAKE_CAMERAS];
} fake_v4l2 = {.lock = PTHREAD_MUTEX_INITIALIZER, .hotplug_fd = -1};

/* ---------------------------------------------------------------- by the test's hand */

static inline void fake_v4l2_init(void)
{
	static const struct fake_control controls[FAKE_CONTROLS] = {
		{.id = V4L2_CID_EXPOSURE_AUTO, .value = V4L2_EXPOSURE_APERTURE_PRIORITY},
		{.id = V4L2_CID_EXPOSURE_AUTO_PRIORITY, .value = 1},
		{.id = V4L2_CID_EXPOSURE_ABSOLUTE, .value = 80},
		{.id = V4L2_CID_AUTOGAIN, .value = 1},
		{.id = V4L2_CID_GAIN, .value = 16},
		{.id = V4L2_CID_AUTO_WHITE_BALANCE, .value = 1},
		{.id = V4L2_CID_WHITE_BALANCE_TEMPERATURE, .value = 5000},
		{.id = V4L2_CID_BACKLIGHT_COMPENSATION, .value = 1},
		{.id = V4L2_CID_POWER_LINE_FREQUENCY, .value = 1},
		{.id = V4L2_CID_SHARPNESS, .value = 3, .minimum = 1, .maximum = 7, .usual = 3},
		{.id = V4L2_CID_GAMMA, .value = 300, .minimum = 100, .maximum = 500, .usual = 220},
		{.id = V4L2_CID_CONTRAST, .value = 40, .maximum = 64, .usual = 32},
		{.id = V4L2_CID_SATURATION, .value = 64, .maximum = 128, .usual = 64},
		{.id = V4L2_CID_HUE, .value = -4, .minimum = -40, .maximum = 40},
		{.id = V4L2_CID_WIDE_DYNAMIC_RANGE, .value = 1, .maximum = 1, .usual = 1},
		{.id = V4L2_CID_IMAGE_STABILIZATION, .value = 1, .maximum = 1},
		{.id = V4L2_CID_COLORFX, .value = 2, .maximum = 15},
		{.id = V4L2_CID_SCENE_MODE, .value = 0, .maximum = 13},
	};

	memset(fake_v4l2.cameras, 0, sizeof(fake_v4l2.cameras));
	fake_v4l2.resets = 0;
	for (int i = 0; i < FAKE_CAMERAS; i++) {
		fake_v4l2.cameras[i].fd = -1;
		fake_v4l2.cameras[i].product = (uint16_t)(0x0102 + i);
		memcpy(fake_v4l2.cameras[i].controls, controls, sizeof(controls));
	}
}

/* A control of a camera; fails where it has none. */
static inline struct fake_control *fake_v4l2_find(int number, uint32_t id)
{
	struct fake_camera *camera = &fake_v4l2.cameras[number];

	for (int i = 0; i < FAKE_CONTROLS; i++) {
		if (camera->controls[i].id == id)
			return &camera->controls[i];
	}
	fail_msg("the camera has no control %#x", id);
	return NULL;
}

/* The kernel and udevd announce a node. */
static inline void fake_v4l2_announce(void)
{
	assert_int_equal(eventfd_write(fake_v4l2.hotplug_fd, 1), 0);
}

static inline void fake_v4l2_plug(int number)
{
	pthread_mutex_lock(&fake_v4l2.lock);
	fake_v4l2.cameras[number].present = true;
	pthread_mutex_unlock(&fake_v4l2.lock);
	if (fake_v4l2.hotplug_fd >= 0)
		fake_v4l2_announce();
}

static inline void fake_v4l2_unplug(int number)
{
	struct fake_camera *camera = &fake_v4l2.cameras[number];

	pthread_mutex_lock(&fake_v4l2.lock);
	camera->present = false;
	camera->streams = false;
	if (camera->fd >= 0) {
		assert_true(camera->fd < FAKE_DESCRIPTORS);
		fake_v4l2.is_dead[camera->fd] = true;
		(void)eventfd_write(camera->fd, 1); /* whoever waits is woken */
	}
	camera->fd = -1;
	pthread_mutex_unlock(&fake_v4l2.lock);
}

/* One frame into a queued buffer. False: none is queued, or the camera does not stream. */
static inline bool fake_v4l2_send(int number, bool corrupt)
{
	struct fake_camera *camera = &fake_v4l2.cameras[number];
	bool sent = false;

	pthread_mutex_lock(&fake_v4l2.lock);
	for (int i = 0; i < camera->buffer_count && camera->streams && !sent; i++) {
		if (!camera->queued[i])
			continue;
		camera->queued[i] = false;
		camera->done[camera->done_count++] = (struct v4l2_buffer){
			.index = (uint32_t)i,
			.bytesused = FAKE_BYTES,
			.flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC |
				 (corrupt ? V4L2_BUF_FLAG_ERROR : 0),
			.sequence = camera->sequence++,
		};
		(void)eventfd_write(camera->fd, 1);
		sent = true;
	}
	pthread_mutex_unlock(&fake_v4l2.lock);
	return sent;
}

/* The descriptor becomes readable, and there is nothing to read. */
static inline void fake_v4l2_wake_without_frame(int number)
{
	pthread_mutex_lock(&fake_v4l2.lock);
	(void)eventfd_write(fake_v4l2.cameras[number].fd, 1);
	pthread_mutex_unlock(&fake_v4l2.lock);
}

static inline int fake_v4l2_get(const int *field)
{
	int value;

	pthread_mutex_lock(&fake_v4l2.lock);
	value = *field;
	pthread_mutex_unlock(&fake_v4l2.lock);
	return value;
}

/* A value of a camera, set while the source's thread may look at it. */
#define FAKE_V4L2_SET(number, field, value)                \
	do {                                               \
		pthread_mutex_lock(&fake_v4l2.lock);       \
		fake_v4l2.cameras[number].field = (value); \
		pthread_mutex_unlock(&fake_v4l2.lock);     \
	} while (0)

/* ---------------------------------------------------------------- the driver's side */

static struct fake_camera *fake_v4l2_of(int fd)
{
	for (int i = 0; i < FAKE_CAMERAS && fd >= 0; i++) {
		if (fake_v4l2.cameras[i].fd == fd)
			return &fake_v4l2.cameras[i];
	}
	return NULL;
}

static int fake_v4l2_set_format(struct v4l2_format *format)
{
	format->fmt.pix.width = FAKE_WIDTH_PX;
	format->fmt.pix.height = FAKE_HEIGHT_PX;
	format->fmt.pix.pixelformat = V4L2_PIX_FMT_GREY;
	format->fmt.pix.bytesperline = FAKE_WIDTH_PX;
	format->fmt.pix.sizeimage = FAKE_BYTES;
	return 0;
}

static int fake_v4l2_stream(struct fake_camera *camera, bool on)
{
	eventfd_t count;

	camera->streams = on;
	camera->sequence = 0;
	if (on)
		return 0;
	memset(camera->queued, 0, sizeof(camera->queued));
	for (; camera->done_count > 0; camera->done_count--)
		(void)eventfd_read(camera->fd, &count);
	return 0;
}

static int fake_v4l2_dequeue(struct fake_camera *camera, struct v4l2_buffer *buffer)
{
	eventfd_t count;

	(void)eventfd_read(camera->fd, &count);
	if (camera->done_count == 0)
		return -EAGAIN;
	*buffer = camera->done[0];
	memmove(camera->done, camera->done + 1,
		(size_t)--camera->done_count * sizeof(camera->done[0]));
	return 0;
}

static int fake_v4l2_control(struct fake_camera *camera, unsigned long request, void *argument)
{
	struct v4l2_control *control = argument;
	struct v4l2_queryctrl *range = argument;
	const uint32_t id = request == VIDIOC_QUERYCTRL ? range->id : control->id;

	camera->control_calls++;
	if (camera->control_error)
		return -camera->control_error;
	for (int i = 0; i < FAKE_CONTROLS; i++) {
		struct fake_control *const found = &camera->controls[i];

		if (found->id != id)
			continue;
		if (request == VIDIOC_QUERYCTRL)
			*range = (struct v4l2_queryctrl){.id = id,
							 .minimum = found->minimum,
							 .maximum = found->maximum ?: 10000,
							 .step = 1,
							 .default_value = found->usual,
							 .flags = found->flags};
		else if (request == VIDIOC_G_CTRL)
			control->value = found->value;
		else if (found->error)
			return -found->error;
		else if (!found->is_stubborn)
			found->value = control->value;
		return 0;
	}
	return -EINVAL;
}

static int fake_v4l2_call(struct fake_camera *camera, unsigned long request, void *argument)
{
	struct v4l2_capability *capability = argument;
	struct v4l2_fmtdesc *format = argument;
	struct v4l2_frmsizeenum *size = argument;
	struct v4l2_frmivalenum *rate = argument;
	struct v4l2_streamparm *parameters = argument;
	struct v4l2_requestbuffers *buffers = argument;
	struct v4l2_buffer *buffer = argument;

	switch (request) {
	case VIDIOC_QUERYCAP:
		capability->capabilities = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
		return 0;
	case VIDIOC_ENUM_FMT:
		format->pixelformat = V4L2_PIX_FMT_GREY;
		return format->index || camera->offers_nothing ? -EINVAL : 0;
	case VIDIOC_ENUM_FRAMESIZES:
		size->type = V4L2_FRMSIZE_TYPE_DISCRETE;
		size->discrete = (struct v4l2_frmsize_discrete){FAKE_WIDTH_PX, FAKE_HEIGHT_PX};
		return size->index ? -EINVAL : 0;
	case VIDIOC_ENUM_FRAMEINTERVALS:
		if (camera->any_rate) {
			rate->type = V4L2_FRMIVAL_TYPE_STEPWISE;
			rate->stepwise = (struct v4l2_frmival_stepwise){.min = {1, 120},
									.max = {1, 5},
									.step = {1, 1000}};
		} else {
			rate->type = V4L2_FRMIVAL_TYPE_DISCRETE;
			rate->discrete = (struct v4l2_fract){1, 100};
		}
		return rate->index ? -EINVAL : 0;
	case VIDIOC_S_FMT:
		return fake_v4l2_set_format(argument);
	case VIDIOC_S_PARM:
	case VIDIOC_G_PARM:
		if (camera->any_rate && request == VIDIOC_S_PARM) {
			camera->interval = parameters->parm.capture.timeperframe;
			return 0;
		}
		parameters->parm.capture.timeperframe = (struct v4l2_fract){1, 100};
		return 0;
	case VIDIOC_REQBUFS:
		camera->buffer_count = (int)buffers->count;
		return 0;
	case VIDIOC_QUERYBUF:
		buffer->length = FAKE_BYTES;
		return 0;
	case VIDIOC_QBUF:
		camera->queued[buffer->index] = true;
		return 0;
	case VIDIOC_DQBUF:
		return fake_v4l2_dequeue(camera, buffer);
	case VIDIOC_STREAMON:
	case VIDIOC_STREAMOFF:
		return fake_v4l2_stream(camera, request == VIDIOC_STREAMON);
	case VIDIOC_QUERYCTRL:
	case VIDIOC_G_CTRL:
	case VIDIOC_S_CTRL:
		return fake_v4l2_control(camera, request, argument);
	default:
		return -ENOTTY;
	}
}

/* ---------------------------------------------------------------- instead of the system's calls */

int __real_open(const char *path, int flags, ...);
int __wrap_open(const char *path, int flags, ...);
int __real_ioctl(int fd, unsigned long request, ...);
int __wrap_ioctl(int fd, unsigned long request, ...);
int __real_close(int fd);
int __wrap_close(int fd);
void *__real_mmap(void *address, size_t length, int protection, int flags, int fd, off_t offset);
void *__wrap_mmap(void *address, size_t length, int protection, int flags, int fd, off_t offset);
int __wrap_lp_v4l2_nodes_read(const char *sysfs, struct lp_v4l2_node *nodes, int capacity);
int __wrap_lp_v4l2_hotplug_open(void);
bool __wrap_lp_v4l2_hotplug_read(int fd);
int __wrap_lp_v4l2_reset_port(const struct lp_v4l2_node *node);

int __wrap_open(const char *path, int flags, ...)
{
	struct fake_camera *camera;
	va_list arguments;
	int number, mode, ret;

	va_start(arguments, flags);
	mode = flags & O_CREAT ? va_arg(arguments, int) : 0;
	va_end(arguments);
	if (sscanf(path, "/dev/video%d", &number) != 1 || number >= FAKE_CAMERAS)
		return __real_open(path, flags, mode);
	pthread_mutex_lock(&fake_v4l2.lock);
	camera = &fake_v4l2.cameras[number];
	camera->opened++;
	errno = camera->present ? camera->open_error : ENOENT;
	ret = errno ? -1 : eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK | EFD_SEMAPHORE);
	if (ret >= 0)
		camera->fd = ret;
	pthread_mutex_unlock(&fake_v4l2.lock);
	return ret;
}

int __wrap_ioctl(int fd, unsigned long request, ...)
{
	struct fake_camera *camera;
	va_list arguments;
	void *argument;
	bool is_dead;
	int ret;

	va_start(arguments, request);
	argument = va_arg(arguments, void *);
	va_end(arguments);
	pthread_mutex_lock(&fake_v4l2.lock);
	camera = fake_v4l2_of(fd);
	is_dead = fd >= 0 && fd < FAKE_DESCRIPTORS && fake_v4l2.is_dead[fd];
	ret = is_dead ? -ENODEV : camera ? fake_v4l2_call(camera, request, argument) : 0;
	pthread_mutex_unlock(&fake_v4l2.lock);
	if (!camera && !is_dead)
		return __real_ioctl(fd, request, argument);
	errno = -ret;
	return ret < 0 ? -1 : 0;
}

int __wrap_close(int fd)
{
	struct fake_camera *camera;

	pthread_mutex_lock(&fake_v4l2.lock);
	camera = fake_v4l2_of(fd);
	if (camera) {
		(void)fake_v4l2_stream(camera, false);
		camera->fd = -1;
	}
	if (fd >= 0 && fd < FAKE_DESCRIPTORS)
		fake_v4l2.is_dead[fd] = false;
	if (fd == fake_v4l2.hotplug_fd)
		fake_v4l2.hotplug_fd = -1;
	pthread_mutex_unlock(&fake_v4l2.lock);
	return __real_close(fd);
}

void *__wrap_mmap(void *address, size_t length, int protection, int flags, int fd, off_t offset)
{
	bool is_fake;

	pthread_mutex_lock(&fake_v4l2.lock);
	is_fake = fake_v4l2_of(fd);
	pthread_mutex_unlock(&fake_v4l2.lock);
	return is_fake ? __real_mmap(NULL, length, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0)
		       : __real_mmap(address, length, protection, flags, fd, offset);
}

int __wrap_lp_v4l2_nodes_read(const char *sysfs, struct lp_v4l2_node *nodes, int capacity)
{
	int count = 0;

	(void)sysfs;
	pthread_mutex_lock(&fake_v4l2.lock);
	for (int i = 0; i < FAKE_CAMERAS && count < capacity; i++) {
		struct lp_v4l2_node *node = &nodes[count];

		if (!fake_v4l2.cameras[i].present)
			continue;
		*node = (struct lp_v4l2_node){.usb = true,
					      .vendor = 0x1d6b,
					      .product = fake_v4l2.cameras[i].product};
		(void)snprintf(node->path, sizeof(node->path), "/dev/video%d", i);
		(void)snprintf(node->name, sizeof(node->name), "model %04x", node->product);
		(void)snprintf(node->port, sizeof(node->port), "1-%d", i);
		count++;
	}
	pthread_mutex_unlock(&fake_v4l2.lock);
	return count;
}

int __wrap_lp_v4l2_hotplug_open(void)
{
	return fake_v4l2.hotplug_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
}

bool __wrap_lp_v4l2_hotplug_read(int fd)
{
	eventfd_t count;

	return eventfd_read(fd, &count) == 0;
}

int __wrap_lp_v4l2_reset_port(const struct lp_v4l2_node *node)
{
	(void)node;
	pthread_mutex_lock(&fake_v4l2.lock);
	fake_v4l2.resets++;
	pthread_mutex_unlock(&fake_v4l2.lock);
	return 0;
}

#endif
