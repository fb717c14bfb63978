/* SPDX-License-Identifier: Apache-2.0 */
/* What the libcamera source decides without a camera; with one: tests/kernel. */
#include <libcamera/control_ids.h>
#include <libcamera/formats.h>
#include <libcamera/libcamera.h>

#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <memory>
#include <thread>
#include <vector>

#include <sys/resource.h>

#include "drivers/source/libcamera/c.hpp"
#include "drivers/source/libcamera/log.hpp"
#include "drivers/source/libcamera/manager.hpp"
#include "drivers/source/libcamera/metadata.hpp"
#include "drivers/source/libcamera/neutral.hpp"
#include "drivers/source/libcamera/offers.hpp"

extern "C" {
#include "lp_test.h"

#include "base/uri.h"
#include "camera_file_test.h"
}

extern "C" const lp_source_ops lp_source_libcamera_ops;

namespace controls = libcamera::controls;
namespace formats = libcamera::formats;

namespace
{

void test_a_request_reports_exposure_and_gain(void **)
{
	libcamera::ControlList metadata(controls::controls);
	lp_frame frame{};

	metadata.set(controls::ExposureTime, 12345);
	metadata.set(controls::AnalogueGain, 2.0F);
	metadata.set(controls::DigitalGain, 1.5F);
	assert_true(lp::describe_frame(metadata, frame));
	assert_float_equal(frame.exposure_us, 12345, 0);
	assert_float_equal(frame.gain, 3, 1e-6);
	assert_float_equal(lp_frame_exposure_us(&frame), 3 * 12345, 0.1);
}

void test_gain_without_digital_gain(void **)
{
	libcamera::ControlList metadata(controls::controls);
	lp_frame frame{};

	metadata.set(controls::ExposureTime, 100);
	metadata.set(controls::AnalogueGain, 4.0F);
	assert_true(lp::describe_frame(metadata, frame));
	assert_float_equal(frame.gain, 4, 0);
}

void test_a_request_that_reports_no_exposure(void **)
{
	libcamera::ControlList metadata(controls::controls);
	lp_frame frame{};

	frame.exposure_us = 7;
	metadata.set(controls::SensorTimestamp, 5);
	assert_false(lp::describe_frame(metadata, frame));
	assert_float_equal(frame.exposure_us, 7, 0);
	assert_int_equal(frame.flags, 0);
}

void test_offers_of_fixed_sizes(void **)
{
	const std::map<libcamera::PixelFormat, std::vector<libcamera::SizeRange>> camera{
		{formats::R8, {libcamera::SizeRange({640, 320})}},
		{formats::MJPEG,
		 {libcamera::SizeRange({640, 320}), libcamera::SizeRange({1920, 960})}},
	};
	lp_offers offers;
	lp_offer_choice choice;
	lp_offer_wish wish{};

	lp::list_offers(libcamera::StreamFormats(camera), offers);
	assert_int_equal(offers.count, 3);
	assert_int_equal(lp_offers_choose(&offers, &wish, &choice), 0);
	assert_int_equal(choice.format, LP_FORMAT_MJPEG);
	assert_int_equal(choice.width_px, 1920);
	wish.format = LP_FORMAT_GREY;
	assert_int_equal(lp_offers_choose(&offers, &wish, &choice), 0);
	assert_true(lp::pixel_format(choice.fourcc) == formats::R8);
	wish.size_px = {800, 400};
	assert_int_equal(lp_offers_choose(&offers, &wish, &choice), -EINVAL);
}

void test_offers_of_any_size(void **)
{
	const std::map<libcamera::PixelFormat, std::vector<libcamera::SizeRange>> camera{
		{formats::NV12, {libcamera::SizeRange({32, 32}, {4056, 3040}, 2, 2)}},
		{formats::BGR888, {libcamera::SizeRange({32, 32}, {4056, 3040}, 2, 2)}},
	};
	lp_offers offers;
	lp_offer_choice choice;
	lp_offer_wish wish{};

	lp::list_offers(libcamera::StreamFormats(camera), offers);
	wish.size_px = {1014, 760};
	assert_int_equal(lp_offers_choose(&offers, &wish, &choice), 0);
	assert_int_equal(choice.format, LP_FORMAT_NV12);
	wish.size_px = {1015, 760};
	assert_int_equal(lp_offers_choose(&offers, &wish, &choice), -EINVAL);
	/* Left open: a usual size, not the whole of a large sensor. */
	wish.size_px = {0, 0};
	assert_int_equal(lp_offers_choose(&offers, &wish, &choice), 0);
	assert_int_equal(choice.width_px, 1920);
}

int read_settings(const char *text, const char *profile, lp_libcamera_settings *settings)
{
	lp_camera_file *file;
	lp_uri uri;

	assert_int_equal(lp_uri_parse(&uri, text), 0);
	if (!profile)
		return lp_libcamera_settings_read(&uri, nullptr, settings);
	int ret = read_camera_file(profile, &file);

	if (ret < 0)
		return ret;
	const lp_camera_profile camera = lp_camera_file_profile(file);

	ret = lp_libcamera_settings_read(&uri, &camera, settings);
	lp_camera_file_destroy(file);
	return ret;
}

void test_settings(void **)
{
	lp_libcamera_settings settings;

	assert_int_equal(read_settings("libcamera:imx477?fps=15&colour_gains=1.5,2", nullptr,
				       &settings),
			 0);
	assert_string_equal(settings.name, "imx477");
	assert_float_equal(settings.wish.fps, 15, 0);
	assert_float_equal(settings.colour_gains.values[1], 2, 0);
	assert_true(settings.exposure_settable);
	assert_int_equal(read_settings("libcamera:",
				       "[camera]\nwidth_px = 1014\nheight_px = 760\n"
				       "[libcamera]\nexposure = auto\nformat = nv12\n"
				       "[v4l2]\nformat = mjpeg\n",
				       &settings),
			 0);
	assert_int_equal(settings.wish.size_px.width, 1014);
	assert_int_equal(settings.wish.format, LP_FORMAT_NV12);
	assert_false(settings.exposure_settable);
}

void test_faults_in_settings_are_told(void **)
{
	lp_libcamera_settings settings;
	struct capture capture;

	capture_begin(&capture);
	assert_int_equal(read_settings("libcamera:?colour_gains=1", nullptr, &settings), -EINVAL);
	assert_int_equal(read_settings("libcamera:?exposure=best", nullptr, &settings), -EINVAL);
	assert_int_equal(read_settings("libcamera:?speed=1", nullptr, &settings), -EINVAL);
	assert_int_equal(read_settings("libcamera:", "[libcamera]\ngain = 2\n", &settings),
			 -EBADMSG);
	capture_end(&capture);
	assert_contains(capture.text, "two numbers are needed, RED,BLUE");
	assert_contains(capture.text, "settable or auto");
	assert_contains(capture.text, "speed: unknown key");
	assert_contains(capture.text, ":2: gain: unknown key");
}

void test_the_camera_that_is_meant(void **)
{
	const char *const usb = "\\_SB_.PCI0.XHC-1:1.0-2e1a:1000";
	const char *const csi = "/base/soc/i2c0mux/i2c@1/imx477@1a";
	lp_libcamera_settings settings;

	assert_int_equal(read_settings("libcamera:", nullptr, &settings), 0);
	assert_true(lp_libcamera_is_meant(&settings, csi, "imx477"));
	assert_int_equal(read_settings("libcamera:imx477", nullptr, &settings), 0);
	assert_true(lp_libcamera_is_meant(&settings, csi, "imx477"));
	assert_false(lp_libcamera_is_meant(&settings, csi, "imx708"));
	assert_int_equal(read_settings("libcamera:/base/soc/i2c0mux/i2c@1/imx477@1a", nullptr,
				       &settings),
			 0);
	assert_true(lp_libcamera_is_meant(&settings, csi, "imx477"));
	assert_int_equal(read_settings("libcamera:2e1a:1000", nullptr, &settings), 0);
	assert_true(lp_libcamera_is_meant(&settings, usb, "Insta360 Air"));
	assert_false(lp_libcamera_is_meant(&settings, csi, "imx477"));
	assert_int_equal(read_settings("libcamera:", "[camera]\nmatch = usb:2e1a:1000\n",
				       &settings),
			 0);
	assert_true(lp_libcamera_is_meant(&settings, usb, "Insta360 Air"));
	assert_false(lp_libcamera_is_meant(&settings, csi, "imx477"));
}

/* A camera with some processing, of which all but the saturation can be neutral. */
libcamera::ControlInfoMap camera_that_processes()
{
	libcamera::ControlInfoMap::Map map{
		{&controls::AeEnable, libcamera::ControlInfo(false, true)},
		{&controls::Sharpness, libcamera::ControlInfo(0.0F, 16.0F, 1.0F)},
		{&controls::Contrast, libcamera::ControlInfo(0.0F, 32.0F, 1.0F)},
		{&controls::Saturation, libcamera::ControlInfo(1.5F, 2.0F, 1.5F)},
		{&controls::draft::NoiseReductionMode,
		 libcamera::ControlInfo(controls::draft::NoiseReductionModeValues)},
	};

	return {std::move(map), controls::controls};
}

void test_processing_that_is_listed_is_neutral(void **)
{
	const libcamera::ControlInfoMap has = camera_that_processes();
	libcamera::ControlList wanted(has);
	lp_processing_report report{};

	lp::neutralize(has, wanted, report);
	assert_int_equal(wanted.size(), 3);
	assert_float_equal(*wanted.get(controls::Sharpness), 0, 0);
	assert_float_equal(*wanted.get(controls::Contrast), 1, 0);
	assert_int_equal(*wanted.get(controls::draft::NoiseReductionMode),
			 controls::draft::NoiseReductionModeOff);
	assert_int_equal(report.on, LP_PROCESSING_BIT(LP_PROCESSING_SATURATION));
	assert_contains(report.on_text, "Saturation ([1.5");
}

/* Exposure, which the same request asked for, is not lost with it. */
void test_processing_that_is_refused_is_on(void **)
{
	const libcamera::ControlInfoMap has = camera_that_processes();
	libcamera::ControlList wanted(has);
	lp_processing_report report{};

	lp::neutralize(has, wanted, report);
	wanted.set(controls::AeEnable, false);
	assert_true(lp::give_up_neutral(wanted, report));
	assert_int_equal(wanted.size(), 1);
	assert_true(wanted.contains(controls::AeEnable.id()));
	assert_int_equal(report.on, LP_PROCESSING_BIT(LP_PROCESSING_SATURATION) |
					    LP_PROCESSING_BIT(LP_PROCESSING_SHARPNESS) |
					    LP_PROCESSING_BIT(LP_PROCESSING_CONTRAST) |
					    LP_PROCESSING_BIT(LP_PROCESSING_NOISE_REDUCTION));
	assert_string_equal(report.off_text, "");
	assert_false(lp::give_up_neutral(wanted, report));
}

/* libcamera ends a program that has two managers at a time, as two sources would. */
void test_sources_share_the_manager(void **)
{
	lp::take_over_log();
	for (int round = 0; round < 3; round++) {
		const auto first = std::make_unique<lp::ManagerUse>();
		auto second = std::make_unique<lp::ManagerUse>();

		assert_int_equal(first->error(), 0);
		assert_int_equal(second->error(), 0);
		assert_ptr_equal(&first->get(), &second->get());
		second.reset();
		(void)first->get().cameras(); /* which lives on */
	}
}

void test_the_manager_is_used_from_many_threads(void **)
{
	std::vector<std::thread> threads;
	std::atomic<int> errors = 0;

	lp::take_over_log();
	for (int i = 0; i < 4; i++)
		threads.emplace_back([&errors] {
			for (int round = 0; round < 10; round++)
				errors += lp::ManagerUse().error() < 0;
		});
	for (std::thread &thread : threads)
		thread.join();
	assert_int_equal(errors, 0);
}

/* What create() has made so far is given back; the sanitizers watch. */
void test_create_without_descriptors(void **)
{
	lp_source_host host{};
	lp_source *source = nullptr;
	struct capture capture;
	rlimit limit, none;
	lp_uri uri;

	assert_int_equal(lp_uri_parse(&uri, "libcamera:"), 0);
	assert_int_equal(getrlimit(RLIMIT_NOFILE, &limit), 0);
	none = limit;
	none.rlim_cur = 0;
	capture_begin(&capture);
	assert_int_equal(setrlimit(RLIMIT_NOFILE, &none), 0);
	const int ret = lp_source_libcamera_ops.create(&uri, &host, &source);

	assert_int_equal(setrlimit(RLIMIT_NOFILE, &limit), 0);
	capture_end(&capture);
	assert_int_equal(ret, -ENOMEM);
	assert_null(source);
	assert_contains(capture.text, "libcamera: create: out of memory or descriptors");
	lp_source_libcamera_ops.destroy(nullptr);
	assert_int_equal(lp_source_libcamera_ops.create(&uri, &host, &source), 0);
	source->ops->destroy(source);
}

} // namespace

int main()
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_request_reports_exposure_and_gain),
		cmocka_unit_test(test_gain_without_digital_gain),
		cmocka_unit_test(test_a_request_that_reports_no_exposure),
		cmocka_unit_test(test_offers_of_fixed_sizes),
		cmocka_unit_test(test_offers_of_any_size),
		cmocka_unit_test(test_settings),
		cmocka_unit_test(test_faults_in_settings_are_told),
		cmocka_unit_test(test_the_camera_that_is_meant),
		cmocka_unit_test(test_processing_that_is_listed_is_neutral),
		cmocka_unit_test(test_processing_that_is_refused_is_on),
		cmocka_unit_test(test_sources_share_the_manager),
		cmocka_unit_test(test_the_manager_is_used_from_many_threads),
		cmocka_unit_test(test_create_without_descriptors),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
