/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The thread that drives a camera of libcamera's: waits for it, opens it, hands its frames on, and
 * begins anew when it stalls or goes. libcamera has threads of its own beneath.
 */
#ifndef LP_SOURCE_LIBCAMERA_CAPTURE_HPP
#define LP_SOURCE_LIBCAMERA_CAPTURE_HPP

#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "drivers/source/libcamera/manager.hpp"
#include "drivers/source/libcamera/session.hpp"

namespace lp
{

class Capture
{
      public:
	explicit Capture(const lp_libcamera_settings &settings);
	/* Waits for the thread. Frames must be back by then. */
	~Capture();
	Capture(const Capture &) = delete;
	Capture &operator=(const Capture &) = delete;

	/* All on the loop thread. */
	bool is_valid() const;	      /* false: out of memory or descriptors */
	int start(lp_source *source); /* whose host gets frames and states. 0 or -errno */
	lp_source_caps caps();
	/* 0; -EINVAL, -EOPNOTSUPP: logged. */
	int set_exposure(float exposure_us, float gain);

      private:
	void run();
	std::unique_ptr<Session> open();
	std::shared_ptr<libcamera::Camera> find();
	void use(Session &session);
	void deliver(Session &session);
	void command(Session &session);
	bool wait_until(int64_t end_ns);
	void notify();
	void report(lp_source_state state, const std::string &stage, const std::string &reason);
	void name_object(const std::string &camera_id);

	const lp_libcamera_settings settings;
	lp_source_outbox *const outbox;
	lp_pool *const frames;
	std::thread thread;

	std::mutex lock; /* of what follows, up to the next comment */
	std::condition_variable changed;
	bool stop = false;
	bool news = false;
	bool is_open = false;
	lp_source_caps present{};
	float wanted_us = NAN, wanted_gain = NAN; /* NAN: nothing new */

	/* The thread's own. */
	std::optional<ManagerUse> manager; /* from open() to the end of the session */
	std::string object;		   /* names the camera in messages */
	lp_backoff retry{};
	int64_t silent_ns = 0;	  /* since when there is no usable frame */
	bool has_corrupt = false; /* frames since then */
	bool has_frames = false;  /* usable ones, since it was opened */
	uint64_t next_sequence = 0;
	lp_frame_clock clock{};
	lp_processing_report processing_told{}; /* logged last */
};

} // namespace lp

#endif
