/* SPDX-License-Identifier: Apache-2.0 */
/* What is timed: anything that takes one JPEG picture. */
#ifndef LP_BENCH_CONTESTANT_HPP
#define LP_BENCH_CONTESTANT_HPP

#include <cstdint>
#include <ctime>
#include <memory>
#include <string>
#include <utility>
#include <vector>

struct lp_camera_file;

namespace bench
{

struct picture {
	std::vector<uint8_t> jpeg;
	int width_px, height_px;
	std::vector<picture> shorter; /* exposures of the same scene, each shorter than the last */
};

struct timing {
	std::string name;
	int64_t ns;
};

/* Processor time of this thread, which does all the work: what other programs take from the machine
 * meanwhile does not count. */
inline int64_t now_ns()
{
	timespec t;

	clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
	return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

struct contestant {
	std::string name;

	explicit contestant(std::string its_name) : name(std::move(its_name))
	{
	}
	virtual ~contestant() = default;
	/* The work; aborts the program when it fails. */
	virtual void run(const picture &picture) = 0;
	/* Result of the last run as JSON, for checks and accuracy. */
	virtual std::string result() const
	{
		return "null";
	}
	/* Run under the clock. */
	virtual std::vector<timing> measure(const picture &picture)
	{
		const int64_t begin_ns = now_ns();

		run(picture);
		return {{name, now_ns() - begin_ns}};
	}
};

using contestants = std::vector<std::unique_ptr<contestant>>;

void add_decodes(contestants &list);
void add_pipelines(contestants &list, const lp_camera_file &camera);
void add_stages(contestants &list, const lp_camera_file &camera);
void add_published(contestants &list);
void add_projections(contestants &list);

/* A libjpeg-turbo decompressor to RGB at 1/divisor, as the baselines use it. */
struct decoder {
	int divisor, width_px = 0, height_px = 0;
	std::vector<uint8_t> rgb;

	explicit decoder(int divisor = 1);
	~decoder();
	decoder(const decoder &) = delete;
	decoder &operator=(const decoder &) = delete;
	void decode(const picture &picture);

      private:
	void *turbo;
};

[[noreturn]] void die(const char *what, const char *why);

} /* namespace bench */

#endif
