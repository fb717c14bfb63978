/* SPDX-License-Identifier: Apache-2.0 */
#include "app/series/series.h"

#include <errno.h>
#include <math.h>
#include <signal.h>
#include <string.h>

#include "app/backends.h"
#include "app/daemon.h"
#include "app/options/fixed_exposure.h"
#include "app/options/options.h"
#include "app/series/series_writer.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "estimate/exposures/bracket.h"
#include "include/frame.h"
#include "include/source.h"
#include "vision/camera/camera_file.h"

#define TICK_NS (100 * LP_NS_PER_MS)

struct series {
	const struct lp_options *options;
	struct lp_camera_file *camera_file;
	struct lp_loop *loop;
	struct lp_timer tick;
	struct lp_source *source;
	struct lp_series_writer *writer;
	struct lp_floats schedule; /* what of the user's this camera can do; empty: as it comes */
	struct lp_series_shot shot;
	int frames;  /* since the command */
	bool begun;  /* the camera has streamed */
	bool ending; /* no more frames are wanted */
	enum lp_exit exit_code;
};

static void end(struct series *series, enum lp_exit exit_code)
{
	if (series->ending)
		return;
	series->ending = true;
	series->exit_code = exit_code;
	lp_loop_stop(series->loop);
}

/* The user's exposures as the camera rounds them; what then repeats itself is left out. */
static void make_schedule(struct series *series, const struct lp_source_caps *caps)
{
	const struct lp_bracket_limits limits = lp_bracket_limits_of(caps);
	const struct lp_floats *wanted = &series->options->series_us;
	struct lp_floats *schedule = &series->schedule;

	schedule->count = 0;
	for (int i = 0; i < wanted->count; i++) {
		const float us = lp_bracket_allowed(&limits, wanted->values[i]);

		if (schedule->count == 0 || schedule->values[schedule->count - 1] != us)
			schedule->values[schedule->count++] = us;
	}
}

/* Command step `step` of the schedule. */
static void command(struct series *series, int step)
{
	const float us = series->schedule.values[step];
	const float gain = series->options->gain > 0 ? series->options->gain : 1.0F;
	const int ret = series->source->ops->set_exposure(series->source, us / gain, gain);

	if (ret < 0) {
		lp_error(series->options->source.texts[0], "exposure",
			 "%g us: %s — the series ends", (double)us, lp_strerror(ret));
		end(series, LP_EXIT_FAILURE);
		return;
	}
	series->shot = (struct lp_series_shot){.step = step,
					       .exposure_us = us,
					       .t_command_ns = lp_clock_ns()};
	series->frames = 0;
}

static void on_frame(void *context, struct lp_frame *frame)
{
	struct series *series = context;
	const bool last = frame->flags & LP_FRAME_LAST;
	const int wanted = series->options->series_frames;

	if (series->ending) {
		lp_frame_release(frame);
		return;
	}
	lp_series_writer_put(series->writer, frame, &series->shot);
	series->frames++;
	if (last)
		end(series, LP_EXIT_OK);
	else if (!wanted || series->frames < wanted)
		return;
	else if (series->shot.step + 1 < series->schedule.count)
		command(series, series->shot.step + 1);
	else
		end(series, LP_EXIT_OK);
}

/* Before the series begins: the source says how many there were. */
static void on_corrupt_frame(void *context)
{
	(void)context;
}

static void begin(struct series *series)
{
	struct lp_source_caps caps;

	series->source->ops->caps(series->source, &caps);
	series->begun = true;
	if (lp_series_writer_start(series->writer, series->source->ops->info.scheme, &caps) < 0) {
		end(series, LP_EXIT_FAILURE);
		return;
	}
	if (series->options->series_us.count == 0)
		return;
	if (!caps.exposure_settable || !series->source->ops->set_exposure) {
		lp_error(series->options->source.texts[0], "exposure",
			 "this camera's exposure cannot be set — leave --series-us out to take its "
			 "frames as they come");
		end(series, LP_EXIT_FAILURE);
		return;
	}
	/* Else the exposures in the index would be wrong by this factor. */
	if (!lp_gain_is_offered(&caps, series->options->gain, series->options->source.texts[0])) {
		end(series, LP_EXIT_FAILURE);
		return;
	}
	make_schedule(series, &caps);
	command(series, 0);
}

static void on_state(void *context, enum lp_source_state state, const char *reason)
{
	struct series *series = context;

	(void)reason; /* the source has logged it */
	if (series->ending)
		return;
	if (state == LP_SOURCE_STREAMING && !series->begun) {
		begin(series);
	} else if (state == LP_SOURCE_DOWN || (state == LP_SOURCE_WAITING && series->begun)) {
		lp_error(series->options->source.texts[0], "series",
			 "the camera is gone and the series is not complete — run it again");
		end(series, LP_EXIT_FAILURE);
	} else if (state == LP_SOURCE_ENDED) {
		end(series, series->begun ? LP_EXIT_OK : LP_EXIT_FAILURE);
	}
}

static void on_signal(void *context, int signal_number)
{
	lp_info("lightprobed", "signal", "%s: ending", strsignal(signal_number));
	end(context, LP_EXIT_FAILURE);
}

static void on_tick(struct lp_timer *timer)
{
	struct series *series = LP_CONTAINER_OF(timer, struct series, tick);

	if (lp_series_writer_error(series->writer) < 0)
		end(series, LP_EXIT_FAILURE);
	lp_log_flush(0);
}

static int open_source(struct series *series)
{
	struct lp_camera_profile camera;
	const struct lp_source_host host = {.context = series,
					    .loop = series->loop,
					    .once = true,
					    .frame = on_frame,
					    .corrupt = on_corrupt_frame,
					    .state = on_state,
					    .camera = &camera};
	const int ret =
		lp_camera_file_read(lp_options_camera(series->options, 0), &series->camera_file);

	if (ret < 0)
		return ret;
	camera = lp_camera_file_profile(series->camera_file);
	return lp_source_open(series->options->source.texts[0], &host, &series->source);
}

/* Everything that can be wrong in what the user wrote shows here. */
static int create_all(struct series *series)
{
	const struct lp_options *options = series->options;
	struct lp_source_caps caps;
	int ret;

	if (options->source.count != 1 || options->once) {
		lp_error("lightprobed", "--series",
			 "needs one --source, and cannot be combined with --once");
		return -EINVAL;
	}
	ret = open_source(series);
	if (ret < 0)
		return ret;
	series->source->ops->caps(series->source, &caps);
	if (options->series_us.count && !series->source->ops->set_exposure) {
		lp_error(options->source.texts[0], "--series-us",
			 "the exposure of this source cannot be set — leave it out");
		return -EINVAL;
	}
	if (!options->series_frames && !caps.finite) {
		lp_error(options->source.texts[0], "--series-frames",
			 "a camera never ends — give the number of frames");
		return -EINVAL;
	}
	return lp_series_writer_create(options->series, &series->writer);
}

static int start_all(struct series *series)
{
	int ret = lp_loop_on_end(series->loop, on_signal, series);

	lp_timer_init(series->loop, &series->tick, on_tick);
	lp_timer_set(&series->tick, TICK_NS, TICK_NS);
	if (ret < 0) {
		lp_error("lightprobed", "loop", "%s", lp_strerror(ret));
		return ret;
	}
	return series->source->ops->start(series->source);
}

int lp_series_run(const struct lp_options *options)
{
	struct series series = {.options = options,
				.shot = {.step = -1, .exposure_us = NAN},
				.exit_code = LP_EXIT_USAGE};

	if (lp_loop_create(&series.loop) < 0) {
		lp_error("lightprobed", "loop", "out of memory or descriptors");
		return LP_EXIT_FAILURE;
	}
	if (create_all(&series) == 0) {
		series.exit_code = LP_EXIT_FAILURE;
		if (start_all(&series) == 0)
			lp_loop_run(series.loop);
	}
	lp_timer_stop(&series.tick);
	/* Frames go back before their source. */
	if (series.writer &&
	    lp_series_writer_finish(series.writer, series.exit_code == LP_EXIT_OK) < 0)
		series.exit_code = LP_EXIT_FAILURE;
	if (series.source)
		series.source->ops->destroy(series.source);
	lp_loop_destroy(series.loop);
	lp_camera_file_destroy(series.camera_file);
	lp_log_flush(1);
	return series.exit_code;
}
