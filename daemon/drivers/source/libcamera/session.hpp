/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One open camera of libcamera's, from open() to close(). Its pictures are copied into frames of
 * the source's own: pipelines have few buffers, in memory that is slow to read out of order, and
 * planes that may lie apart.
 */
#ifndef LP_SOURCE_LIBCAMERA_SESSION_HPP
#define LP_SOURCE_LIBCAMERA_SESSION_HPP

#include <libcamera/libcamera.h>

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <sys/types.h>

#include "drivers/source/libcamera/c.hpp"

namespace lp
{

/* Why a camera cannot be opened. */
struct Fault {
	lp_source_state state;
	std::string stage, reason;
};

/* A node in /dev; plugged in again it has the same path, but not the same inode. */
struct Node {
	std::string path;
	ino_t inode;
};

/* All calls from the thread that opened it. */
class Session
{
      public:
	/*
	 * Acquires, configures and starts the camera with these nodes. Frames come from `frames`
	 * (lp_owned_frames_create); `first_sequence` is the number of the first; `clock` is
	 * borrowed, and knows the camera from sessions before. `wake` is called,
	 * from libcamera's thread, when take() or gone() have news. NULL: `fault` says why.
	 */
	static std::unique_ptr<Session> open(std::shared_ptr<libcamera::Camera> camera,
					     std::vector<Node> nodes,
					     const lp_libcamera_settings &settings, lp_pool *frames,
					     uint64_t first_sequence, lp_frame_clock &clock,
					     std::function<void()> wake, Fault &fault);
	/* Stops the camera. Its frames may be out. */
	~Session();
	Session(const Session &) = delete;
	Session &operator=(const Session &) = delete;

	/* From the next request on. */
	void set_exposure(float exposure_us, float gain);
	/* The oldest finished frame, for the caller to release; NULL: none. */
	lp_frame *take();
	/* libcamera says that it was unplugged. */
	bool gone();
	/* Its nodes are there; false: it was unplugged, and libcamera will say so. */
	bool present() const;
	/* When take() has something to do, frame or not; INT64_MAX: only when a frame comes. */
	int64_t rest_end_ns() const;
	/* What it can do; all of it is known after the first frame. */
	lp_source_caps caps() const;
	/* What was done about its processing; known after the first frame, too. */
	const lp_processing_report &processing() const;
	uint64_t next_sequence() const;
	/* "MJPEG 1920x960" */
	std::string description() const;

      private:
	struct Plane {
		const uint8_t *data;
		size_t length_bytes;
		int fd;
	};
	/* A request, and where the camera writes its picture. */
	struct Slot {
		std::unique_ptr<libcamera::Request> request;
		std::vector<Plane> planes;
	};
	struct Mapping {
		void *memory;
		size_t length_bytes;
	};

	Session(std::shared_ptr<libcamera::Camera> camera, std::vector<Node> nodes,
		const lp_libcamera_settings &settings, lp_pool *frames, uint64_t first_sequence,
		lp_frame_clock &clock, std::function<void()> wake);

	bool start(Fault &fault);
	void await_disconnection();
	bool choose(Fault &fault);
	bool allocate(Fault &fault);
	int map(const libcamera::FrameBuffer &buffer, Slot &slot);
	void hold_still();
	void hold_exposure();
	void queue(libcamera::Request &request);
	void queue_later(libcamera::Request &request);
	void queue_rested();
	void put_exposure(libcamera::ControlList &controls);
	lp_frame *make_frame(libcamera::Request &request);
	int copy(const Slot &slot, const libcamera::FrameMetadata &about,
		 lp_owned_frame &out) const;
	void give_up(libcamera::Request &request);
	libcamera::Request *next_done();
	void complete(libcamera::Request *request); /* on libcamera's thread */
	void disconnect();			    /* on libcamera's thread */

	const lp_libcamera_settings settings;
	const std::vector<Node> nodes;
	lp_pool *const frames;
	lp_frame_clock &clock;
	const std::function<void()> wake;
	std::shared_ptr<libcamera::Camera> camera;
	std::unique_ptr<libcamera::CameraConfiguration> configuration;
	std::unique_ptr<libcamera::FrameBufferAllocator> allocator;
	libcamera::Stream *stream = nullptr;
	lp_offer_choice choice{};
	uint32_t stride_bytes = 0;
	size_t picture_bytes = 0; /* of a complete raw picture; 0: MJPEG */
	std::vector<Slot> slots;  /* by the request's cookie */
	std::vector<Mapping> mappings;

	lp_processing_report processing_done{};
	bool settable = false;
	bool reports_exposure = false;	/* as the caps say; known after the first frame */
	libcamera::ControlList wanted;	/* for the next request */
	libcamera::ControlList neutral; /* for the second one */
	float wanted_us = NAN, wanted_gain = NAN;
	lp_exposure_guess guess{};		   /* where frames do not report it */
	std::vector<libcamera::Request *> resting; /* not queued before t_rest_end_ns */
	int64_t t_rest_end_ns = INT64_MAX;
	const uint64_t first_sequence;
	uint64_t following_sequence;

	std::mutex lock;		 /* of what follows */
	std::condition_variable changed; /* is_gone has */
	bool is_gone = false;
	std::vector<libcamera::Request *> done; /* oldest first; as long as there are slots */
};

} // namespace lp

#endif
