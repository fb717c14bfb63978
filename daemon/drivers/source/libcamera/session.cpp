/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/libcamera/session.hpp"

#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <map>

#include <linux/dma-buf.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "drivers/source/libcamera/metadata.hpp"
#include "drivers/source/libcamera/neutral.hpp"
#include "drivers/source/libcamera/offers.hpp"

namespace controls = libcamera::controls;

namespace lp
{
namespace
{

/* Being filled, waiting for it, and being copied. Pipelines may insist on another number. */
constexpr unsigned BUFFERS = 4;
constexpr std::chrono::seconds DISCONNECTION_WITHIN{60};
constexpr int64_t REST_NS = 100 * LP_NS_PER_MS;
/* The unit of exposure of USB cameras, the only ones whose frames do not tell theirs. */
constexpr float UVC_STEP_US = 100;

bool fail(Fault &fault, lp_source_state state, const char *stage, const std::string &reason)
{
	fault = {state, stage, reason};
	return false;
}

/* A call failed: what its error means, and what to do about it. */
bool fail_call(Fault &fault, int error, const char *stage)
{
	switch (error) {
	case -EBUSY:
		return fail(fault, LP_SOURCE_WAITING, stage,
			    "device busy — is another program using it? (fuser -v /dev/video* "
			    "/dev/media*)");
	case -EACCES:
	case -EPERM:
		return fail(fault, LP_SOURCE_WAITING, stage,
			    "no permission — add this user to the group video (usermod -aG video "
			    "USER, then log in again), or install "
			    "packaging/udev/70-lightprobe.rules");
	case -EIO:
	case -EPIPE:
	case -EPROTO:
	case -ETIMEDOUT:
		return fail(fault, LP_SOURCE_STALLED, stage,
			    std::string("the camera does not answer (") + lp_strerror(error) +
				    ") — trying again");
	default:
		return fail(fault, LP_SOURCE_WAITING, stage, lp_strerror(error));
	}
}

/* The CPU begins or ends to read a picture; without a cache between, this does nothing. */
void sync_memory(int fd, uint64_t edge)
{
	dma_buf_sync sync{};

	sync.flags = edge | DMA_BUF_SYNC_READ;
	(void)ioctl(fd, DMA_BUF_IOCTL_SYNC, &sync);
}

/* The control's limits, as floats; false: the camera has no such control. */
template <typename T>
bool limits(const libcamera::ControlInfoMap &map, const libcamera::Control<T> &control,
	    float &least, float &most)
{
	const auto found = map.find(control.id());

	if (found == map.end() || found->second.min().isNone() || found->second.max().isNone())
		return false;
	least = static_cast<float>(found->second.min().template get<T>());
	most = static_cast<float>(found->second.max().template get<T>());
	return true;
}

} // namespace

Session::Session(std::shared_ptr<libcamera::Camera> opened, std::vector<Node> its_nodes,
		 const lp_libcamera_settings &how, lp_pool *pool, uint64_t sequence,
		 lp_frame_clock &its_clock, std::function<void()> notify)
    : settings(how), nodes(std::move(its_nodes)), frames(pool), clock(its_clock),
      wake(std::move(notify)), camera(std::move(opened)), wanted(camera->controls()),
      neutral(camera->controls()), first_sequence(sequence), following_sequence(sequence)
{
}

/*
 * libcamera ends the program when it is to stop a camera that was unplugged, unless udev has told
 * it so before. Whoever finds the camera's node gone waits for that.
 */
void Session::await_disconnection()
{
	std::unique_lock<std::mutex> guard(lock);

	(void)changed.wait_for(guard, DISCONNECTION_WITHIN, [this] { return is_gone; });
}

Session::~Session()
{
	if (!present())
		await_disconnection();
	(void)camera->stop();
	/* Of an unplugged camera stop() does nothing. Whatever libcamera's thread was asked to do
	 * before this is done after it, so that nothing below is in use. */
	(void)camera->invokeMethod(&libcamera::Camera::stop, libcamera::ConnectionTypeBlocking);
	camera->requestCompleted.disconnect(this);
	camera->disconnected.disconnect(this);
	slots.clear();
	for (const Mapping &mapping : mappings)
		munmap(mapping.memory, mapping.length_bytes);
	allocator.reset();
	(void)camera->release();
}

std::unique_ptr<Session> Session::open(std::shared_ptr<libcamera::Camera> camera,
				       std::vector<Node> nodes,
				       const lp_libcamera_settings &settings, lp_pool *frames,
				       uint64_t first_sequence, lp_frame_clock &clock,
				       std::function<void()> wake, Fault &fault)
{
	const int ret = camera->acquire();

	if (ret < 0) {
		fail_call(fault, ret, "acquire");
		return nullptr;
	}
	std::unique_ptr<Session> session(new Session(std::move(camera), std::move(nodes), settings,
						     frames, first_sequence, clock,
						     std::move(wake)));

	return session->start(fault) ? std::move(session) : nullptr;
}

/* ---------------------------------------------------------------- setting up */

bool Session::choose(Fault &fault)
{
	lp_offers offers;
	char reason[LP_SOURCE_REASON_BYTES];

	configuration = camera->generateConfiguration({libcamera::StreamRole::VideoRecording});
	if (!configuration || configuration->empty())
		return fail(fault, LP_SOURCE_DOWN, "configuration", "it gives no video stream");
	libcamera::StreamConfiguration &wish = configuration->at(0);

	list_offers(wish.formats(), offers);
	if (lp_offers_choose(&offers, &settings.wish, &choice) < 0) {
		lp_offers_refuse(&offers, &settings.wish, reason, sizeof(reason));
		return fail(fault, LP_SOURCE_DOWN, "choose", reason);
	}
	wish.pixelFormat = pixel_format(choice.fourcc);
	wish.size = libcamera::Size(choice.width_px, choice.height_px);
	wish.bufferCount = BUFFERS;
	if (configuration->validate() == libcamera::CameraConfiguration::Invalid ||
	    wish.pixelFormat != pixel_format(choice.fourcc) ||
	    wish.size != libcamera::Size(choice.width_px, choice.height_px))
		return fail(fault, LP_SOURCE_DOWN, "validate",
			    "the camera sets another format or size than it offers (" +
				    wish.toString() + ") — choose another format or size");
	return true;
}

/* Maps each piece of memory once; planes may share one. */
int Session::map(const libcamera::FrameBuffer &buffer, Slot &slot)
{
	std::map<int, const uint8_t *> mapped;

	for (const auto &plane : buffer.planes()) {
		const int fd = plane.fd.get();

		if (!mapped.count(fd)) {
			const auto length_bytes = static_cast<size_t>(lseek(fd, 0, SEEK_END));
			void *memory = mmap(nullptr, length_bytes, PROT_READ, MAP_SHARED, fd, 0);

			if (memory == MAP_FAILED)
				return -errno;
			mappings.push_back({memory, length_bytes});
			mapped[fd] = static_cast<const uint8_t *>(memory);
		}
		slot.planes.push_back({mapped[fd] + plane.offset, plane.length, fd});
	}
	return 0;
}

bool Session::allocate(Fault &fault)
{
	int ret;

	allocator = std::make_unique<libcamera::FrameBufferAllocator>(camera);
	ret = allocator->allocate(stream);
	if (ret < 0)
		return fail_call(fault, ret, "allocate");
	for (const auto &buffer : allocator->buffers(stream)) {
		Slot slot;

		ret = map(*buffer, slot);
		if (ret < 0)
			return fail_call(fault, ret, "mmap");
		slot.request = camera->createRequest(slots.size());
		ret = slot.request ? slot.request->addBuffer(stream, buffer.get()) : -ENOMEM;
		if (ret < 0)
			return fail_call(fault, ret, "request");
		slots.push_back(std::move(slot));
	}
	done.reserve(slots.size());
	return true;
}

/* What goes along with the first request: everything automatic off. */
void Session::hold_still()
{
	const libcamera::ControlInfoMap &has = camera->controls();

	if (has.find(controls::AwbEnable.id()) != has.end())
		wanted.set(controls::AwbEnable, false);
	if (settings.processing != LP_PROCESSING_KEEP)
		neutralize(has, neutral, processing_done);
	if (settings.colour_gains.count && has.find(controls::ColourGains.id()) != has.end())
		wanted.set(controls::ColourGains,
			   libcamera::Span<const float, 2>(settings.colour_gains.values, 2));
	if (settings.wish.fps > 0 && has.find(controls::FrameDurationLimits.id()) != has.end()) {
		const auto duration_us = static_cast<int64_t>(1e6F / settings.wish.fps);

		wanted.set(controls::FrameDurationLimits, {duration_us, duration_us});
	} else if (settings.wish.fps > 0) {
		lp_warning("libcamera", "fps", "%g: libcamera cannot set this camera's rate",
			   static_cast<double>(settings.wish.fps));
	}
}

void Session::hold_exposure()
{
	const libcamera::ControlInfoMap &has = camera->controls();
	float least = NAN, most = NAN;

	lp_exposure_guess_init(&guess, settings.exposure_delay_frames);
	if (!settings.exposure_settable)
		return;
	settable = limits(has, controls::ExposureTime, least, most);
	if (!settable) {
		lp_warning("libcamera", "exposure",
			   "it has no exposure control: no brackets, and light levels are relative "
			   "to each frame");
		return;
	}
	if (has.find(controls::AeEnable.id()) != has.end())
		wanted.set(controls::AeEnable, false);
	/* What it has now cannot be asked for. */
	const libcamera::ControlValue &usual = has.at(controls::ExposureTime.id()).def();

	set_exposure(usual.isNone() ? std::sqrt(std::fmax(least, 1.0F) * most)
				    : static_cast<float>(usual.get<int32_t>()),
		     1);
}

bool Session::start(Fault &fault)
{
	int ret;

	if (!choose(fault))
		return false;
	ret = camera->configure(configuration.get());
	if (ret < 0)
		return fail_call(fault, ret, "configure");
	stream = configuration->at(0).stream();
	stride_bytes = configuration->at(0).stride;
	if (choice.format != LP_FORMAT_MJPEG) {
		if (!stride_bytes)
			stride_bytes = lp_row_bytes(choice.format, choice.width_px);
		picture_bytes = lp_picture_bytes(choice.format, stride_bytes, choice.height_px);
	} else {
		stride_bytes = 0;
	}
	if (!allocate(fault))
		return false;
	hold_still();
	hold_exposure();
	camera->requestCompleted.connect(this, &Session::complete);
	camera->disconnected.connect(this, &Session::disconnect);
	ret = camera->start();
	if (ret < 0)
		return fail_call(fault, ret, "start");
	for (const Slot &slot : slots) {
		queue(*slot.request);
		wanted.merge(neutral); /* by the second: so a refusal says of what */
		neutral.clear();
	}
	return true;
}

/* ---------------------------------------------------------------- running */

/* What was asked for goes along with this request. */
void Session::put_exposure(libcamera::ControlList &list)
{
	const libcamera::ControlInfoMap &has = camera->controls();
	float least = NAN, most = NAN;

	if (std::isnan(wanted_us) || !limits(has, controls::ExposureTime, least, most))
		return;
	float exposure_us = std::fmin(std::fmax(wanted_us, least), most);

	if (!reports_exposure)
		exposure_us = std::fmax(std::round(exposure_us / UVC_STEP_US), 1.0F) * UVC_STEP_US;
	list.set(controls::ExposureTime, static_cast<int32_t>(exposure_us));
	/* Where frames do not tell their gain, its steps mean nothing: it stays at its least. */
	if (limits(has, controls::AnalogueGain, least, most))
		list.set(controls::AnalogueGain,
			 reports_exposure ? std::fmin(std::fmax(wanted_gain, least), most) : least);
	if (exposure_us != guess.exposure_us)
		lp_exposure_guess_command(&guess, exposure_us, 1, lp_clock_ns());
	wanted_us = NAN;
}

/*
 * libcamera ends the program, too, when it comes upon a request that the camera cannot take after
 * it has been told that the camera has gone. So a camera without its node gets none.
 */
void Session::queue(libcamera::Request &request)
{
	if (!present())
		return;
	request.reuse(libcamera::Request::ReuseBuffers);
	request.controls().merge(wanted);
	wanted.clear();
	put_exposure(request.controls());
	(void)camera->queueRequest(&request); /* fails for a camera that has gone: gone() tells */
}

/*
 * The last pictures of a camera that is being unplugged are corrupt, and its node is still there
 * for a moment. So the request of a corrupt picture is queued again only after REST_NS: by then the
 * node has gone, if the camera has.
 */
void Session::queue_later(libcamera::Request &request)
{
	resting.push_back(&request);
	t_rest_end_ns = lp_clock_ns() + REST_NS;
}

void Session::queue_rested()
{
	for (libcamera::Request *const request : resting)
		queue(*request);
	resting.clear();
	t_rest_end_ns = INT64_MAX;
}

void Session::set_exposure(float exposure_us, float gain)
{
	wanted_us = exposure_us;
	wanted_gain = gain;
}

/* The planes one behind the other, into the frame's own memory. */
int Session::copy(const Slot &slot, const libcamera::FrameMetadata &about,
		  lp_owned_frame &out) const
{
	const auto used = about.planes();
	const size_t planes = std::min(used.size(), slot.planes.size());
	lp_frame &frame = out.frame;

	for (size_t i = 0; i < planes; i++) {
		const Plane &plane = slot.planes[i];
		const size_t part_bytes = std::min<size_t>(used[i].bytesused, plane.length_bytes);
		const int ret = lp_owned_frame_reserve(&out, frame.size_bytes + part_bytes);

		if (ret < 0)
			return ret;
		sync_memory(plane.fd, DMA_BUF_SYNC_START);
		memcpy(out.buffer + frame.size_bytes, plane.data, part_bytes);
		sync_memory(plane.fd, DMA_BUF_SYNC_END);
		frame.size_bytes += part_bytes;
	}
	return 0;
}

/* NULL: all frames are out, and this one is lost; its number tells. */
lp_frame *Session::make_frame(libcamera::Request &request)
{
	const Slot &slot = slots[request.cookie()];
	const libcamera::FrameMetadata &about = request.findBuffer(stream)->metadata();
	const auto stamp_ns = static_cast<int64_t>(about.timestamp);
	lp_owned_frame *owned = lp_owned_frame_take(frames, false);

	if (!owned)
		return nullptr;
	lp_frame &frame = owned->frame;

	if (copy(slot, about, *owned) < 0) {
		lp_frame_release(&frame);
		return nullptr;
	}
	frame.format = choice.format;
	frame.width_px = choice.width_px;
	frame.height_px = choice.height_px;
	frame.stride_bytes = stride_bytes;
	frame.sequence = first_sequence + about.sequence;
	frame.t_arrival_ns = lp_clock_ns();
	if (about.status != libcamera::FrameMetadata::FrameSuccess || !frame.size_bytes ||
	    frame.size_bytes < picture_bytes)
		frame.flags |= LP_FRAME_CORRUPT;
	lp_frame_clock_stamp(&clock, &frame, stamp_ns, "libcamera");
	const bool described = describe_frame(request.metadata(), frame);

	if (!described)
		lp_exposure_guess_frame(&guess, &frame);
	if (!(frame.flags & LP_FRAME_CORRUPT)) /* whose metadata may be missing */
		reports_exposure = described;
	following_sequence = frame.sequence + 1;
	return &frame;
}

/* The camera refused a request. Where it asked for something, that stood in the way. */
void Session::give_up(libcamera::Request &request)
{
	if (request.controls().empty() || !present())
		return; /* it does not even take a plain one: silence follows, and is noticed */
	libcamera::ControlList asked(camera->controls());

	asked.merge(request.controls());
	if (give_up_neutral(asked, processing_done)) {
		wanted.merge(asked);
		queue(request);
		return;
	}
	if (settable)
		lp_warning("libcamera", "exposure",
			   "it refuses to be set: no brackets, and light levels are relative to "
			   "each frame");
	settable = false;
	lp_exposure_guess_init(&guess, settings.exposure_delay_frames);
	queue(request);
}

lp_frame *Session::take()
{
	while (libcamera::Request *const request = next_done()) {
		if (request->status() == libcamera::Request::RequestCancelled) {
			give_up(*request);
			continue;
		}
		const auto status = request->findBuffer(stream)->metadata().status;
		lp_frame *const frame = make_frame(*request);

		if (status == libcamera::FrameMetadata::FrameSuccess)
			queue(*request);
		else
			queue_later(*request);
		if (frame)
			return frame;
	}
	if (lp_clock_ns() >= t_rest_end_ns)
		queue_rested();
	return nullptr;
}

/* ---------------------------------------------------------------- libcamera's thread */

void Session::complete(libcamera::Request *request)
{
	{
		const std::lock_guard<std::mutex> guard(lock);

		done.push_back(request);
	}
	wake();
}

void Session::disconnect()
{
	{
		const std::lock_guard<std::mutex> guard(lock);

		is_gone = true;
	}
	changed.notify_all();
	wake();
}

libcamera::Request *Session::next_done()
{
	const std::lock_guard<std::mutex> guard(lock);

	if (is_gone || done.empty())
		return nullptr;
	libcamera::Request *const request = done.front();

	done.erase(done.begin());
	return request;
}

/* ---------------------------------------------------------------- asked by the owner */

bool Session::gone()
{
	const std::lock_guard<std::mutex> guard(lock);

	return is_gone;
}

bool Session::present() const
{
	for (const Node &node : nodes) {
		struct stat about;

		if (stat(node.path.c_str(), &about) < 0 || about.st_ino != node.inode)
			return false;
	}
	return true;
}

lp_source_caps Session::caps() const
{
	const libcamera::ControlInfoMap &has = camera->controls();
	lp_source_caps caps{};

	caps.exposure_min_us = caps.exposure_max_us = caps.gain_min = caps.gain_max = NAN;
	caps.exposure_delay_frames = settings.exposure_delay_frames;
	caps.reports_exposure = reports_exposure;
	caps.tells_processing = settings.processing != LP_PROCESSING_KEEP;
	caps.processing_on = processing_done.on;
	caps.exposure_settable = settable && limits(has, controls::ExposureTime,
						    caps.exposure_min_us, caps.exposure_max_us);
	if (!caps.exposure_settable)
		return caps;
	caps.exposure_step_us = reports_exposure ? 1 : UVC_STEP_US;
	if (!reports_exposure || !limits(has, controls::AnalogueGain, caps.gain_min, caps.gain_max))
		caps.gain_min = caps.gain_max = 1;
	return caps;
}

const lp_processing_report &Session::processing() const
{
	return processing_done;
}

int64_t Session::rest_end_ns() const
{
	return t_rest_end_ns;
}

uint64_t Session::next_sequence() const
{
	return following_sequence;
}

std::string Session::description() const
{
	return pixel_format(choice.fourcc).toString() + " " + std::to_string(choice.width_px) +
	       "x" + std::to_string(choice.height_px);
}

} // namespace lp
