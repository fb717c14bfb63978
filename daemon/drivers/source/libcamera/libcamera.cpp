/* SPDX-License-Identifier: Apache-2.0 */
/*
 * libcamera:CAMERA - a camera through libcamera: CSI cameras of single-board computers, with
 * exposure and gain per request and, from their frames' metadata, known exactly. This file is the
 * back end as the loop sees it; the camera is driven by a thread, capture.cpp.
 */
#include "drivers/source/libcamera/capture.hpp"

#include <cerrno>
#include <exception>
#include <memory>
#include <system_error>

struct lp_uri;

namespace
{

/* As C sees it: the base first. */
struct SourceLibcamera {
	lp_source base;
	lp::Capture *capture;
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
		return capture_of(source).start(source);
	} catch (const std::system_error &error) {
		lp_error("libcamera", "start", "no thread: %s", error.what());
		return -EAGAIN;
	}
}

void libcamera_caps(const lp_source *source, lp_source_caps *caps)
{
	*caps = capture_of(source).caps();
}

int libcamera_set_exposure(lp_source *source, float exposure_us, float gain)
{
	return capture_of(source).set_exposure(exposure_us, gain);
}

const char libcamera_help[] =
	"a camera through libcamera\n"
	"CAMERA is its identity, its model, or VENDOR:PRODUCT; leave it out for the camera that\n"
	"--camera matches, or for the only one. The keys may also be in the camera file,\n"
	"section [libcamera].";

} // namespace

extern "C" const lp_source_ops lp_source_libcamera_ops;
const lp_source_ops lp_source_libcamera_ops = {
	{"libcamera", "CAMERA", libcamera_help, &lp_libcamera_params, nullptr},
	libcamera_create,
	libcamera_start,
	libcamera_caps,
	libcamera_set_exposure,
	nullptr, /* no stills */
	libcamera_destroy,
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
		auto capture = std::make_unique<lp::Capture>(settings);
		auto self = std::make_unique<SourceLibcamera>();

		if (!capture->is_valid()) {
			lp_error("libcamera", "create", "out of memory or descriptors");
			return -ENOMEM;
		}
		self->base = {&lp_source_libcamera_ops, *host};
		self->capture = capture.release();
		*source = &self.release()->base;
		return 0;
	} catch (const std::exception &error) {
		lp_error("libcamera", "create", "%s", error.what());
		return -ENOMEM;
	}
}

} // namespace
