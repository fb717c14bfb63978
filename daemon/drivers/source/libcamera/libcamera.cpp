/* SPDX-License-Identifier: Apache-2.0 */
/*
 * libcamera:CAMERA - a camera through libcamera: CSI cameras of single-board computers, with
 * exposure and gain per request and, from their frames' metadata, known exactly. This file is the
 * back end as the loop sees it; the camera is driven by a thread, source_libcamera_capture.cpp.
 */
#include "drivers/source/libcamera/capture.hpp"

#include <cerrno>
#include <exception>
#include <new>
#include <system_error>

struct lp_uri;

namespace
{

/* As C sees it: the base first. */
struct SourceLibcamera {
	lp_source base;
	lp::Capture *capture;
	lp_source_news news;
};

lp::Capture &capture_of(const lp_source *source)
{
	return *reinterpret_cast<const SourceLibcamera *>(source)->capture;
}

void libcamera_destroy(lp_source *source)
{
	auto *self = reinterpret_cast<SourceLibcamera *>(source);

	if (!self)
		return;
	delete self->capture;
	delete self;
}

int libcamera_create(const lp_uri *uri, const lp_source_host *host, lp_source **source);

int libcamera_start(lp_source *source) noexcept
{
	try {
		capture_of(source).start();
		return 0;
	} catch (const std::system_error &error) {
		lp_error("libcamera", "start", "no thread: %s", error.what());
		return -EAGAIN;
	}
}

int libcamera_fd(const lp_source *source)
{
	return capture_of(source).fd();
}

int libcamera_dispatch(lp_source *source)
{
	auto *self = reinterpret_cast<SourceLibcamera *>(source);
	lp_source_news &news = self->news;

	if (!self->capture->take(news))
		return 0;
	if (news.frame)
		source->host.frame(source->host.context, news.frame);
	else
		source->host.state(source->host.context, news.state, news.reason);
	return 0;
}

void libcamera_caps(const lp_source *source, lp_source_caps *caps)
{
	*caps = capture_of(source).caps();
}

int libcamera_set_exposure(lp_source *source, float exposure_us, float gain)
{
	return capture_of(source).set_exposure(exposure_us, gain);
}

const char help[] =
	"libcamera:CAMERA  a camera through libcamera, by its identity, its model, or\n"
	"      VENDOR:PRODUCT; nothing for the only one, or the one that --camera matches\n"
	"      ?size=WxH &format=auto|mjpeg|yuyv|nv12|grey &fps=30 &exposure=settable|auto\n"
	"      &exposure_delay_frames=N &colour_gains=RED,BLUE &stall_ms=1000";

} // namespace

extern "C" const lp_source_ops lp_source_libcamera_ops;
const lp_source_ops lp_source_libcamera_ops = {
	"libcamera",	    help,	    libcamera_create,	    libcamera_start,   libcamera_fd,
	libcamera_dispatch, libcamera_caps, libcamera_set_exposure, libcamera_destroy,
};

namespace
{

int libcamera_create(const lp_uri *uri, const lp_source_host *host, lp_source **source)
{
	lp_libcamera_settings settings;
	const int ret = lp_libcamera_settings_read(uri, host->camera, &settings);

	if (ret < 0)
		return ret;
	try {
		auto *self = new SourceLibcamera{{&lp_source_libcamera_ops, *host}, nullptr, {}};

		*source = &self->base;
		self->capture = new lp::Capture(settings);
		if (self->capture->is_valid())
			return 0;
		libcamera_destroy(*source);
		return -ENOMEM;
	} catch (const std::exception &error) {
		lp_error("libcamera", "create", "%s", error.what());
		return -ENOMEM;
	}
}

} // namespace
