/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/libcamera/capture.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <exception>

#include <glob.h>
#include <sys/stat.h>
#include <unistd.h>

#include "drivers/source/libcamera/log.hpp"

namespace lp
{
namespace
{

constexpr int FRAMES = LP_FRAMES_HELD + 3; /* waiting for the worker, on their way, being filled */
constexpr int64_t RETRY_FIRST_NS = 100 * LP_NS_PER_MS;
constexpr int64_t RETRY_LONGEST_NS = LP_NS_PER_S;
constexpr int64_t FIRST_FRAME_NS = 5 * LP_NS_PER_S; /* cameras take their time to start */

std::string model_of(const libcamera::Camera &camera)
{
	return camera.properties().get(libcamera::properties::Model).value_or("");
}

/* Whether a device is one of the camera's: until libcamera 0.1 its manager says that, later the
 * camera. */
bool is_device_of([[maybe_unused]] libcamera::CameraManager &manager,
		  const std::shared_ptr<libcamera::Camera> &camera, dev_t device)
{
#if LIBCAMERA_VERSION_MAJOR == 0 && LIBCAMERA_VERSION_MINOR == 0
	return manager.get(device) == camera;
#else
	const auto devices = camera->properties().get(libcamera::properties::SystemDevices);

	return devices && std::find(devices->begin(), devices->end(),
				    static_cast<int64_t>(device)) != devices->end();
#endif
}

std::vector<Node> nodes_of(libcamera::CameraManager &manager,
			   const std::shared_ptr<libcamera::Camera> &camera)
{
	std::vector<Node> nodes;
	glob_t paths;

	if (glob("/dev/video*", 0, nullptr, &paths) != 0)
		return nodes;
	for (size_t i = 0; i < paths.gl_pathc; i++) {
		struct stat about;

		if (stat(paths.gl_pathv[i], &about) == 0 &&
		    is_device_of(manager, camera, about.st_rdev))
			nodes.push_back({paths.gl_pathv[i], about.st_ino});
	}
	globfree(&paths);
	return nodes;
}

/* A media device that this user may not open; "": none. libcamera leaves such cameras out. */
std::string forbidden_device()
{
	std::string found;
	glob_t paths;

	if (glob("/dev/media*", 0, nullptr, &paths) != 0)
		return "";
	for (size_t i = 0; i < paths.gl_pathc && found.empty(); i++) {
		if (access(paths.gl_pathv[i], R_OK | W_OK) < 0 && errno == EACCES)
			found = paths.gl_pathv[i];
	}
	globfree(&paths);
	return found;
}

} // namespace

Capture::Capture(const lp_libcamera_settings &how)
    : settings(how), outbox(lp_source_outbox_create()), frames(lp_owned_frames_create(FRAMES))
{
	retry = {RETRY_FIRST_NS, RETRY_LONGEST_NS, 0};
	present.exposure_min_us = present.exposure_max_us = NAN;
	present.gain_min = present.gain_max = NAN;
	present.exposure_delay_frames = -1;
}

Capture::~Capture()
{
	{
		const std::lock_guard<std::mutex> guard(lock);

		stop = true;
	}
	lp_source_outbox_close(outbox);
	changed.notify_all();
	if (thread.joinable())
		thread.join();
	lp_source_outbox_destroy(outbox);
	lp_pool_destroy(frames);
}

/* ---------------------------------------------------------------- on the loop thread */

bool Capture::is_valid() const
{
	return outbox && frames;
}

int Capture::start(lp_source *source)
{
	const int ret = lp_source_outbox_start(outbox, source);

	if (ret < 0) {
		lp_error("libcamera", "start", "%s", lp_strerror(ret));
		return ret;
	}
	thread = std::thread([this] {
		try {
			run();
		} catch (const std::exception &error) {
			report(LP_SOURCE_DOWN, "libcamera", error.what());
		}
	});
	return 0;
}

lp_source_caps Capture::caps()
{
	const std::lock_guard<std::mutex> guard(lock);

	return present;
}

int Capture::set_exposure(float exposure_us, float gain)
{
	const std::lock_guard<std::mutex> guard(lock);

	if (is_open && !present.exposure_settable) {
		lp_error("libcamera", "exposure", "this camera's exposure cannot be set");
		return -EOPNOTSUPP;
	}
	if (gain != 1 && !present.reports_exposure) {
		lp_error("libcamera", "gain",
			 "%g: the frames of this camera do not report their gain, so its scale is "
			 "unknown",
			 static_cast<double>(gain));
		return -EINVAL;
	}
	wanted_us = exposure_us;
	wanted_gain = gain;
	news = true;
	changed.notify_all();
	return 0;
}

/* ---------------------------------------------------------------- the thread */

/* By its identity once it is known. */
void Capture::name_object(const std::string &camera_id)
{
	const std::string name = camera_id.empty() ? settings.name : camera_id;

	object = "libcamera: " + (name.empty() ? "any" : name);
}

void Capture::report(lp_source_state state, const std::string &stage, const std::string &reason)
{
	lp_source_outbox_report(outbox, state, object.c_str(), stage.c_str(), "%s", reason.c_str());
}

/* From any thread. */
void Capture::notify()
{
	const std::lock_guard<std::mutex> guard(lock);

	news = true;
	changed.notify_all();
}

/* Waits for news, at most until then. False: the thread shall end. */
bool Capture::wait_until(int64_t end_ns)
{
	std::unique_lock<std::mutex> guard(lock);
	const auto left = std::chrono::nanoseconds(std::max<int64_t>(0, end_ns - lp_clock_ns()));

	changed.wait_for(guard, left, [this] { return stop || news; });
	news = false;
	return !stop;
}

/* The camera that is meant; NULL: reported why there is none. */
std::shared_ptr<libcamera::Camera> Capture::find()
{
	std::shared_ptr<libcamera::Camera> found;
	std::string present_ones;
	int matches = 0;

	for (const auto &camera : manager->get().cameras()) {
		const std::string model = model_of(*camera);

		present_ones +=
			(present_ones.empty() ? "" : ", ") + camera->id() + " (" + model + ")";
		if (!lp_libcamera_is_meant(&settings, camera->id().c_str(), model.c_str()))
			continue;
		found = camera;
		matches++;
	}
	if (matches == 1)
		return found;
	const std::string forbidden = matches ? "" : forbidden_device();

	if (matches)
		report(LP_SOURCE_WAITING, "find",
		       "several cameras match — name one by its identity; present: " +
			       present_ones);
	else if (!forbidden.empty())
		report(LP_SOURCE_WAITING, "find",
		       "no permission for " + forbidden +
			       " — add this user to the group video (usermod -aG video USER, then "
			       "log in again), or install packaging/udev/70-lightprobe.rules");
	else
		report(LP_SOURCE_WAITING, "find",
		       "no such camera; " + (present_ones.empty()
						     ? std::string("libcamera finds none")
						     : "present: " + present_ones));
	return nullptr;
}

std::unique_ptr<Session> Capture::open()
{
	Fault fault;

	name_object("");
	manager.emplace();
	if (manager->error() < 0) {
		report(LP_SOURCE_WAITING, "start", lp_strerror(manager->error()));
		return nullptr;
	}
	auto camera = find();

	if (!camera)
		return nullptr;
	name_object(camera->id());
	const std::string model = model_of(*camera);
	auto nodes = nodes_of(manager->get(), camera);
	auto session = Session::open(
		std::move(camera), std::move(nodes), settings, frames, next_sequence, clock,
		[this] { notify(); }, fault);

	if (!session) {
		report(fault.state, fault.stage, fault.reason);
		return nullptr;
	}
	lp_info(object.c_str(), "open", "%s: %s", model.c_str(), session->description().c_str());
	return session;
}

void Capture::command(Session &session)
{
	const std::lock_guard<std::mutex> guard(lock);

	if (std::isnan(wanted_us))
		return;
	session.set_exposure(wanted_us, wanted_gain);
	wanted_us = NAN;
}

void Capture::deliver(Session &session)
{
	lp_frame *frame;

	while ((frame = session.take())) {
		if (frame->flags & LP_FRAME_CORRUPT) {
			has_corrupt = true;
		} else {
			if (!has_frames) { /* what the camera can do is known with the first one */
				lp_processing_tell(&session.processing(), false, &processing_told,
						   object.c_str());
				const std::lock_guard<std::mutex> guard(lock);

				present = session.caps();
				is_open = true;
			}
			silent_ns = frame->t_arrival_ns;
			has_corrupt = false;
			has_frames = true;
		}
		lp_source_outbox_send(outbox, frame, object.c_str());
	}
	if (has_frames)
		lp_backoff_reset(&retry);
}

/* Until the camera goes, stalls, or the thread shall end. */
void Capture::use(Session &session)
{
	silent_ns = lp_clock_ns();
	has_corrupt = false;
	has_frames = false;
	for (;;) {
		const auto patience_ns =
			std::max(static_cast<int64_t>(static_cast<double>(settings.stall_ms) *
						      static_cast<double>(LP_NS_PER_MS)),
				 has_frames ? 0 : FIRST_FRAME_NS);
		const bool goes_on =
			wait_until(std::min(silent_ns + patience_ns, session.rest_end_ns()));

		if (!goes_on)
			return;
		command(session);
		deliver(session);
		if (session.gone()) {
			report(LP_SOURCE_WAITING, "stream",
			       "unplugged: waiting for it to come back");
			return;
		}
		if (lp_clock_ns() < silent_ns + patience_ns)
			continue;
		if (!session.present()) { /* libcamera will say so */
			silent_ns = lp_clock_ns();
			continue;
		}
		report(LP_SOURCE_STALLED, "stream",
		       std::string(has_corrupt ? "only corrupt frames for " : "no frame for ") +
			       std::to_string(patience_ns / LP_NS_PER_MS) +
			       " ms: opening the camera anew");
		return;
	}
}

void Capture::run()
{
	bool goes_on = true;

	take_over_log();
	while (goes_on) {
		auto session = open();

		if (session) {
			use(*session);
			next_sequence = session->next_sequence();
			{
				const std::lock_guard<std::mutex> guard(lock);

				is_open = false;
			}
			session.reset();
		}
		manager.reset();
		/* News of a session that is over would end the wait at once. */
		const int64_t end_ns = lp_clock_ns() + lp_backoff_next_ns(&retry);

		do
			goes_on = wait_until(end_ns);
		while (goes_on && lp_clock_ns() < end_ns);
	}
}

} // namespace lp
