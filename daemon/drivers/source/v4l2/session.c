/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/v4l2/session.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "base/log.h"
#include "drivers/source/v4l2/stream.h"

__attribute__((format(printf, 5, 6))) static int fail(struct lp_v4l2_fault *fault, int error,
						      enum lp_source_state state, const char *stage,
						      const char *format, ...)
{
	va_list arguments;

	fault->state = state;
	fault->stage = stage;
	va_start(arguments, format);
	vsnprintf(fault->reason, sizeof(fault->reason), format, arguments);
	va_end(arguments);
	return error;
}

/* A call to the camera failed: what its error means, and what to do about it. */
static int fail_call(struct lp_v4l2_fault *fault, const struct lp_v4l2_session *session, int error,
		     const char *stage)
{
	const char *const path = session->node.path;

	switch (error) {
	case -EBUSY:
		return fail(fault, error, LP_SOURCE_WAITING, stage,
			    "device busy — is another program using it? (fuser -v %s)", path);
	case -EACCES:
	case -EPERM:
		return fail(
			fault, error, LP_SOURCE_WAITING, stage,
			"no permission — add this user to the group video (usermod -aG video "
			"USER, then log in again), or install packaging/udev/70-lightprobe.rules");
	case -ENOSPC:
		return fail(fault, error, LP_SOURCE_WAITING, stage,
			    "no room left on the USB bus — choose a smaller size or rate, or use "
			    "another port");
	case -EPROTO:
		/* With a stage that says more than the call's name. */
		if (strchr(stage, ':'))
			return fail(fault, error, LP_SOURCE_DOWN, stage,
				    "choose another format or size");
		/* fallthrough */
	case -EIO:
	case -EPIPE:
	case -ETIMEDOUT:
		return fail(fault, error, LP_SOURCE_STALLED, stage,
			    "the camera does not answer (%s) — trying again; if it stays so, "
			    "replug it",
			    lp_strerror(error));
	}
	return fail(fault, error, LP_SOURCE_WAITING, stage, "%s", lp_strerror(error));
}

static int check_capabilities(int fd, struct lp_v4l2_session *session, struct lp_v4l2_fault *fault)
{
	const uint32_t needed = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
	struct v4l2_capability capability = {0};
	uint32_t flags;

	if (ioctl(fd, VIDIOC_QUERYCAP, &capability) < 0)
		return errno == ENOTTY || errno == EINVAL
			       ? fail(fault, -ENOTTY, LP_SOURCE_DOWN, "QUERYCAP",
				      "not a video device")
			       : fail_call(fault, session, -errno, "QUERYCAP");
	flags = capability.capabilities & V4L2_CAP_DEVICE_CAPS ? capability.device_caps
							       : capability.capabilities;
	if ((flags & needed) != needed)
		return fail(fault, -ENOTTY, LP_SOURCE_DOWN, "QUERYCAP",
			    "not a capture device (%.32s, driver %.16s) — v4l2-ctl --list-devices "
			    "shows what is",
			    (const char *)capability.card, (const char *)capability.driver);
	return 0;
}

static int choose(int fd, struct lp_v4l2_session *session, const struct lp_v4l2_settings *settings,
		  struct lp_v4l2_fault *fault)
{
	struct lp_offers offers;
	char reason[400];
	int ret = lp_v4l2_offers_read(fd, &offers);

	if (ret < 0)
		return fail_call(fault, session, ret, "ENUM_FMT");
	ret = lp_offers_choose(&offers, &settings->wish, &session->choice);
	if (ret == 0)
		return 0;
	lp_offers_refuse(&offers, &settings->wish, reason, sizeof(reason));
	return fail(fault, ret, LP_SOURCE_DOWN, "choose", "%s", reason);
}

static void announce(const struct lp_v4l2_session *session)
{
	const struct lp_offer_choice *choice = &session->choice;
	char exposure[48] = "of unknown exposure";

	if (!isnan(session->controls.exposure_us))
		snprintf(exposure, sizeof(exposure), "exposed %g us",
			 (double)session->controls.exposure_us);
	lp_info(session->object, "open", "%s: %.4s %ux%u at %g Hz, %s", session->node.name,
		(const char *)&choice->fourcc, choice->width_px, choice->height_px,
		(double)lp_v4l2_stream_rate_hz(session->stream), exposure);
}

int lp_v4l2_session_open(struct lp_v4l2_session *session, const struct lp_v4l2_node *node,
			 const struct lp_v4l2_settings *settings, struct lp_v4l2_fault *fault)
{
	const char *stage;
	int fd, ret;

	*session = (struct lp_v4l2_session){.node = *node};
	snprintf(session->object, sizeof(session->object), "v4l2: %s", node->path);
	fd = open(node->path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
	if (fd < 0)
		return fail_call(fault, session, -errno, "open");
	ret = check_capabilities(fd, session, fault);
	if (ret == 0)
		ret = choose(fd, session, settings, fault);
	if (ret < 0) {
		close(fd);
		return ret;
	}
	ret = lp_v4l2_stream_start(fd, &session->choice, &session->stream, &stage);
	if (ret < 0)
		return fail_call(fault, session, ret, stage);
	/* Some cameras forget their controls when a stream starts: hold them now, not before. */
	ret = lp_v4l2_controls_hold(&session->controls, fd, session->object, settings);
	if (ret < 0) {
		lp_v4l2_stream_stop(session->stream);
		return fail_call(fault, session, ret, "controls");
	}
	announce(session);
	return 0;
}

void lp_v4l2_session_close(struct lp_v4l2_session *session)
{
	lp_v4l2_controls_restore(&session->controls);
	lp_v4l2_stream_stop(session->stream);
	session->stream = NULL;
}
