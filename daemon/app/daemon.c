/* SPDX-License-Identifier: Apache-2.0 */
#include "app/daemon.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/random.h>
#include <unistd.h>

#include "app/backends.h"
#include "app/fixed_exposure.h"
#include "app/health.h"
#include "app/hub.h"
#include "app/instruments.h"
#include "app/options.h"
#include "app/orientation.h"
#include "app/ring_only.h"
#include "app/ring_watch.h"
#include "app/service.h"
#include "app/time_control.h"
#include "app/worker.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "base/text.h"
#include "include/frame.h"
#include "include/orientation.h"
#include "include/ring_sample.h"
#include "include/source.h"
#include "vision/camera_file.h"

#define TICK_NS (100 * LP_NS_PER_MS)
#define INSECURE_LAN                                                                            \
	"lightprobed: --insecure-lan: anyone on the network can read the light — publish on " \
	"wss: instead (lightprobe pair)"
#define DRAIN_NS (5 * LP_NS_PER_S) /* how long the last packets may take to leave */

struct lp_daemon {
	const struct lp_options *options;
	struct lp_camera_file *camera_file;
	struct lp_loop *loop;
	struct lp_timer tick;
	struct lp_time_control *time_control; /* NULL: the system's time */
	struct lp_watch results;	      /* of the worker */
	uint64_t results_lost;
	struct lp_hub *hub;
	struct lp_worker *worker;
	struct lp_source *source;
	struct lp_source_caps caps;
	struct lp_instruments *instruments;
	struct lp_orientation_teller orientation;
	struct lp_orientation *sensor; /* of orientation; NULL: none */
	char name[64];		       /* of the probe */
	struct lp_publisher *publishers[LP_MAX_PUBLISHERS];
	int publisher_count;
	struct lp_health health;
	struct lp_ring_watch ring_watch;
	struct lp_ring_only ring_only;
	struct lp_estimates ring_estimates; /* of the ring alone: too large for a stack */
	struct lp_governor governor;
	char preset_reason[96]; /* of the last change that was asked for */
	bool has_streamed;
	bool has_frames;	    /* the next two count */
	uint64_t next_sequence;	    /* of the source, if nothing is lost */
	uint64_t frames_lost;	    /* between the camera and us */
	uint64_t frames_corrupt;    /* while the source did not stream: the worker never saw them */
	struct lp_result once_best; /* --once: the newest estimate of the set */
	bool once_has_best;

	int64_t watchdog_ns; /* 0: nobody watches */
	int64_t fed_ns;	     /* the watchdog, last */
	int64_t ending_ns;   /* since when; 0: running */
	enum lp_exit exit_code;
};

/* ---------------------------------------------------------------- the end */

static bool anything_pending(const struct lp_daemon *daemon)
{
	for (int i = 0; i < daemon->publisher_count; i++) {
		const struct lp_publisher *publisher = daemon->publishers[i];

		if (publisher->ops->pending(publisher))
			return true;
	}
	return false;
}

/* Stop the loop once the last packets have left. */
static void continue_ending(struct lp_daemon *daemon)
{
	if (!daemon->ending_ns)
		return;
	if (!anything_pending(daemon) || lp_clock_ns() - daemon->ending_ns > DRAIN_NS)
		lp_loop_stop(daemon->loop);
}

static void begin_ending(struct lp_daemon *daemon, enum lp_exit exit_code)
{
	if (daemon->ending_ns)
		return;
	daemon->ending_ns = lp_clock_ns();
	daemon->exit_code = exit_code;
	lp_service_stopping();
	continue_ending(daemon);
}

static void on_signal(void *context, int signal_number)
{
	struct lp_daemon *daemon = context;

	lp_info("lightprobed", "signal", "%s: ending", strsignal(signal_number));
	/* A set that was interrupted has no estimate. */
	begin_ending(daemon, daemon->options->once ? LP_EXIT_FAILURE : LP_EXIT_OK);
	lp_loop_stop(daemon->loop);
}

/* ---------------------------------------------------------------- from the source */

static void on_stamped_frame(void *context, struct lp_frame *frame)
{
	struct lp_daemon *daemon = context;
	const struct lp_demand demand = lp_hub_demand(daemon->hub);

	lp_orientation_frame(&daemon->orientation, frame);
	/* Simulated time stands still while a frame is at work. */
	if (lp_worker_submit(daemon->worker, frame, &demand))
		lp_loop_hold(daemon->loop);
}

static void on_ring(void *context, const struct lp_ring_sample *sample)
{
	static const struct lp_demand all = {LP_MAX_SH_ORDER, LP_MAX_LIGHTS};
	struct lp_daemon *daemon = context;

	lp_worker_ring(daemon->worker, sample);
	if (!lp_ring_only_sample(&daemon->ring_only, sample, lp_clock_ns(),
				 &daemon->ring_estimates))
		return;
	daemon->ring_estimates.raw.flags |= lp_instruments_flags(daemon->instruments);
	daemon->ring_estimates.smoothed.flags = daemon->ring_estimates.raw.flags;
	lp_hub_publish(daemon->hub, &daemon->ring_estimates, &all);
}

static void on_frame(void *context, struct lp_frame *frame)
{
	struct lp_daemon *daemon = context;

	daemon->health.report.frames_received++;
	/* A smaller number is that of a camera that has come back. */
	if (daemon->has_frames && frame->sequence > daemon->next_sequence)
		daemon->frames_lost += frame->sequence - daemon->next_sequence;
	daemon->next_sequence = frame->sequence + 1;
	daemon->has_frames = true;
	lp_instruments_frame(daemon->instruments, frame);
}

static void on_corrupt_frame(void *context)
{
	struct lp_daemon *daemon = context;

	daemon->health.report.frames_received++;
	daemon->frames_corrupt++;
	daemon->next_sequence++; /* it is no gap */
}

/* What is wrong with the source, for health messages. */
static void set_fault(struct lp_daemon *daemon, enum lp_source_state state, const char *reason)
{
	const char *id = state == LP_SOURCE_WAITING   ? "source-waiting"
			 : state == LP_SOURCE_STALLED ? "source-stalled"
			 : state == LP_SOURCE_DOWN    ? "source-down"
						      : NULL;

	lp_health_fault(&daemon->health, "source-waiting", NULL);
	lp_health_fault(&daemon->health, "source-stalled", NULL);
	lp_health_fault(&daemon->health, "source-down", NULL);
	if (id)
		lp_health_fault(&daemon->health, id, reason);
}

/* A fixed exposure if one is asked for; else the worker makes brackets, where the camera can. */
static void begin_exposures(struct lp_daemon *daemon)
{
	const struct lp_options *options = daemon->options;
	const struct lp_source_caps *caps = &daemon->caps;
	const struct lp_camera_control control = {.settable = caps->exposure_settable &&
							      daemon->source->ops->set_exposure &&
							      options->exposure_us <= 0,
						  .reports_exposure = caps->reports_exposure,
						  .limits = lp_bracket_limits_of(caps)};

	if (options->exposure_us > 0)
		lp_fixed_exposure_command(daemon->source, caps, options->exposure_us, options->gain,
					  options->source);
	lp_worker_control(daemon->worker, &control);
}

/* The source has logged it. */
static void on_source_fault(void *context, const char *id, const char *text)
{
	struct lp_daemon *daemon = context;

	lp_health_fault(&daemon->health, id, text);
}

static void on_state(void *context, enum lp_source_state state, const char *reason)
{
	static const char *const names[] = {"unknown",	 "down",    "waiting",
					    "streaming", "stalled", "ended"};
	struct lp_daemon *daemon = context;
	char status[256];

	if (state == LP_SOURCE_STREAMING && daemon->has_streamed &&
	    daemon->health.report.source_state != LP_SOURCE_STALLED)
		daemon->health.report.source_reconnects++;
	daemon->has_streamed |= state == LP_SOURCE_STREAMING;
	daemon->health.report.source_state = state;
	set_fault(daemon, state, reason);
	(void)snprintf(status, sizeof(status), "source %s %s", names[state], reason);
	lp_service_status(status);
	if (state == LP_SOURCE_STREAMING) {
		daemon->source->ops->caps(daemon->source, &daemon->caps);
		begin_exposures(daemon);
	}
	if (state == LP_SOURCE_DOWN && daemon->options->once)
		begin_ending(daemon, LP_EXIT_FAILURE);
}

/* ---------------------------------------------------------------- from the worker */

/* The set is complete: publish its estimate and end. */
static void finish_once(struct lp_daemon *daemon)
{
	struct lp_light_estimate *raw = &daemon->once_best.estimates.raw;

	if (!daemon->once_has_best) {
		lp_error("lightprobed", "once", "no picture gave an estimate (see above)");
		begin_ending(daemon, LP_EXIT_FAILURE);
		return;
	}
	if (lp_worker_rejected(daemon->worker) + daemon->frames_corrupt > 0)
		raw->flags |= LP_ESTIMATE_BRACKET_INCOMPLETE;
	lp_hub_publish(daemon->hub, &daemon->once_best.estimates, &daemon->once_best.demand);
	begin_ending(daemon, LP_EXIT_OK);
}

static void take_once(struct lp_daemon *daemon, const struct lp_result *result)
{
	if (daemon->ending_ns)
		return;
	if (result->status == 0) {
		daemon->once_best = *result;
		daemon->once_has_best = true;
	}
	/* An endless source has no last frame: its first estimate counts. */
	if (result->last_frame || (!daemon->caps.finite && result->status == 0))
		finish_once(daemon);
}

/* Say so when the preset in force has changed. */
static void follow_preset(struct lp_daemon *daemon, const struct lp_result *result)
{
	const struct lp_governor *governor = &daemon->governor;
	const char *const name = lp_preset_name((int)result->preset);
	char text[192];

	if (result->preset_refused) /* the pipeline has logged why */
		lp_governor_refused(&daemon->governor, (int)result->preset);
	if (strcmp(daemon->health.report.preset, name) == 0)
		return;
	daemon->health.report.preset = name;
	lp_hub_preset(daemon->hub, name);
	(void)snprintf(text, sizeof(text), "governor: preset %s instead of %s: %s", name,
		       lp_preset_name(governor->chosen), daemon->preset_reason);
	lp_health_fault(&daemon->health, "preset-lowered",
			(int)result->preset < governor->chosen ? text : NULL);
	lp_info("governor", name, "preset in force: %s", daemon->preset_reason);
}

static void publish(struct lp_daemon *daemon, struct lp_result *result)
{
	const uint32_t flags = lp_instruments_flags(daemon->instruments) |
			       lp_ring_watch_update(&daemon->ring_watch, &result->estimates.ring,
						    &daemon->health, lp_clock_ns());

	result->estimates.raw.flags |= flags;
	result->estimates.smoothed.flags |= flags;
	lp_orientation_judged(&daemon->orientation, &result->estimates.raw.orientation);
	result->estimates.smoothed.orientation = result->estimates.raw.orientation;
	lp_ring_only_camera(&daemon->ring_only, &result->estimates.raw, lp_clock_ns());
	lp_hub_publish(daemon->hub, &result->estimates, &result->demand);
	lp_governor_estimate(&daemon->governor, lp_clock_ns() - result->estimates.raw.t_arrival_ns);
}

/* One frame has its result; frames whose results were lost have none to come. */
static void release_loop(struct lp_daemon *daemon)
{
	const uint64_t lost = lp_worker_results_lost(daemon->worker);

	for (; daemon->results_lost < lost; daemon->results_lost++)
		lp_loop_release(daemon->loop);
	lp_loop_release(daemon->loop);
}

static void on_result(struct lp_watch *watch, unsigned int events)
{
	struct lp_daemon *daemon = LP_CONTAINER_OF(watch, struct lp_daemon, results);
	struct lp_result *result = lp_worker_take(daemon->worker);

	(void)events;
	if (!result)
		return;
	release_loop(daemon);
	follow_preset(daemon, result);
	if (!isnan(result->command_us))
		(void)daemon->source->ops->set_exposure(daemon->source, result->command_us, 1.0F);
	if (daemon->options->once)
		take_once(daemon, result);
	else if (result->status == 0)
		publish(daemon, result);
	lp_worker_give(daemon->worker, result);
	continue_ending(daemon);
}

/* ---------------------------------------------------------------- descriptors and time */

/* A `once` set whose reader left before its estimate has failed. */
static void on_publisher_failed(void *context, int failure)
{
	struct lp_daemon *daemon = context;

	begin_ending(daemon,
		     failure == -EPIPE && !daemon->options->once ? LP_EXIT_OK : LP_EXIT_FAILURE);
}

/* The loop runs, or we would not be here; a worker that has been busy for half the watchdog's
 * patience is stuck. */
static void feed_watchdog(struct lp_daemon *daemon)
{
	const int64_t now_ns = lp_clock_ns();

	if (daemon->watchdog_ns == 0 || now_ns - daemon->fed_ns < daemon->watchdog_ns / 4)
		return;
	if (lp_worker_busy_ns(daemon->worker) > daemon->watchdog_ns / 2) {
		lp_error("worker", "watchdog", "one frame has taken %" PRId64 " ms: not fed",
			 lp_worker_busy_ns(daemon->worker) / LP_NS_PER_MS);
		return;
	}
	daemon->fed_ns = now_ns;
	lp_service_watchdog_feed();
}

/* Ask for a lower or a higher preset, where a goal is set. */
static void govern(struct lp_daemon *daemon)
{
	struct lp_governor *governor = &daemon->governor;

	if (lp_governor_tick(governor, lp_clock_ns(), lp_clock_cpu_ns(), daemon->preset_reason,
			     sizeof(daemon->preset_reason)))
		lp_worker_preset(daemon->worker, (enum lp_preset)governor->preset);
}

static void on_tick(struct lp_timer *timer)
{
	struct lp_daemon *daemon = LP_CONTAINER_OF(timer, struct lp_daemon, tick);
	struct lp_health_report *report = &daemon->health.report;

	report->frames_dropped = lp_worker_dropped(daemon->worker) + daemon->frames_lost;
	report->frames_rejected = lp_worker_rejected(daemon->worker) + daemon->frames_corrupt;
	lp_instruments_tick(daemon->instruments, lp_clock_ns());
	lp_orientation_tick(&daemon->orientation, lp_clock_ns());
	govern(daemon);
	lp_hub_tick(daemon->hub);
	feed_watchdog(daemon);
	lp_log_flush(0);
	continue_ending(daemon);
}

/* ---------------------------------------------------------------- building up and down */

static void set_name(struct lp_daemon *daemon)
{
	char host[sizeof(daemon->name)] = "";

	(void)gethostname(host, sizeof(host) - 1);
	lp_text_copy(daemon->name, sizeof(daemon->name),
		     *daemon->options->name ? daemon->options->name : host);
}

static int on_pose(void *context, const void *client, const struct lp_orientation_sample *sample)
{
	struct lp_daemon *daemon = context;

	return lp_orientation_pose(&daemon->orientation, client, sample);
}

static void on_client_left(void *context, const void *client)
{
	struct lp_daemon *daemon = context;

	lp_orientation_client_left(&daemon->orientation, client);
}

static void on_orientation_sample(void *context, const struct lp_orientation_sample *sample)
{
	struct lp_daemon *daemon = context;

	lp_orientation_sensed(&daemon->orientation, sample);
}

static void on_orientation_fault(void *context, const char *id, const char *text)
{
	struct lp_daemon *daemon = context;

	lp_health_fault(&daemon->health, id, text);
}

static int create_orientation(struct lp_daemon *daemon)
{
	const struct lp_pipeline_options pipeline = lp_options_pipeline(daemon->options);
	const struct lp_orientation_host host = {.context = daemon,
						 .loop = daemon->loop,
						 .sample = on_orientation_sample,
						 .fault = on_orientation_fault};
	struct lp_mount mount;
	const int ret = lp_mount_read(daemon->options->mount, &mount);

	if (ret < 0)
		return ret;
	lp_orientation_init(&daemon->orientation, pipeline.orientation, &mount, &daemon->health);
	return pipeline.orientation == LP_ORIENTATION_SENSOR
		       ? lp_orientation_open(daemon->options->orientation.uri, &host,
					     &daemon->sensor)
		       : 0;
}

static int create_hub(struct lp_daemon *daemon)
{
	const struct lp_options *options = daemon->options;
	const struct lp_pipeline_options pipeline = lp_options_pipeline(options);
	struct lp_hub_options hub = {
		.hello = {.source = daemon->source ? daemon->source->ops->info.scheme : "none",
			  .preset = lp_preset_name(options->preset),
			  .max_sh_order = pipeline.sh_order,
			  .max_lights = pipeline.max_lights,
			  .smoothing_ms = (uint32_t)lrintf(options->smoothing_ms),
			  .has_wheel = *options->rotator,
			  .has_ring = *options->ring,
			  .name = daemon->name,
			  .orientation = lp_orientation_name((int)pipeline.orientation)},
		.initial = lp_default_subscription(),
		.ttl_ms = (uint32_t)lrintf(options->ttl_ms),
		.max_clients = options->max_clients,
		.insecure_lan = options->insecure_lan,
		.health = &daemon->health,
		.loop = daemon->loop,
		.context = daemon,
		.pose = on_pose,
		.left = on_client_left,
		.failed = on_publisher_failed,
	};

	if (getrandom(&hub.hello.boot_id, sizeof(hub.hello.boot_id), GRND_NONBLOCK) < 0)
		hub.hello.boot_id = (uint32_t)lp_clock_unix_ns(lp_clock_ns());
	if (options->once) {
		/* One estimate of this set, as it is, with all that was asked for. */
		hub.initial.raw = true;
		hub.initial.sh_order = pipeline.sh_order;
		hub.initial.max_lights = pipeline.max_lights;
		hub.initial.area_lights = options->area_lights;
		hub.initial.key_light = options->key_light;
	}
	daemon->health.report.preset = hub.hello.preset;
	return lp_hub_create(&hub, &daemon->hub);
}

static int create_source(struct lp_daemon *daemon)
{
	const struct lp_camera_profile camera = lp_camera_file_profile(daemon->camera_file);
	const struct lp_source_host host = {.context = daemon,
					    .loop = daemon->loop,
					    .once = daemon->options->once,
					    .frame = on_frame,
					    .corrupt = on_corrupt_frame,
					    .state = on_state,
					    .fault = on_source_fault,
					    .camera = &camera};
	int ret;

	if (!*daemon->options->source && *daemon->options->ring && !daemon->options->once)
		return 0; /* the ring alone */
	if (!*daemon->options->source) {
		lp_error("lightprobed", "--source",
			 "no source is given — name a camera with --source=URI, or a ring of light "
			 "sensors alone with --ring=URI; lightprobed --help lists the kinds");
		return -EINVAL;
	}
	ret = lp_source_open(daemon->options->source, &host, &daemon->source);
	if (ret < 0)
		return ret;
	daemon->source->ops->caps(daemon->source, &daemon->caps);
	if (daemon->options->exposure_us > 0 && !daemon->source->ops->set_exposure) {
		lp_error(daemon->options->source, "--exposure-us",
			 "the exposure of this source cannot be set");
		return -EINVAL;
	}
	return 0;
}

static int create_instruments(struct lp_daemon *daemon)
{
	const struct lp_instruments_host host = {.context = daemon,
						 .loop = daemon->loop,
						 .frame = on_stamped_frame,
						 .ring = on_ring};

	return lp_instruments_create(daemon->options, &daemon->health, &host, &daemon->instruments);
}

static int create_publishers(struct lp_daemon *daemon)
{
	const struct lp_publisher_host host = lp_hub_publisher_host(daemon->hub);
	int ret = 0;

	for (int i = 0; i < daemon->options->publish.count && ret == 0; i++) {
		ret = lp_publisher_open(daemon->options->publish.texts[i], &host,
					&daemon->publishers[i]);
		if (ret == 0 && daemon->publishers[daemon->publisher_count++]->is_insecure) {
			lp_hub_set_insecure(daemon->hub);
			lp_health_fault(&daemon->health, "insecure-lan", INSECURE_LAN);
		}
	}
	return ret;
}

/* --once: what the ring read while the pictures were taken. */
static void give_ring_lux(struct lp_daemon *daemon)
{
	struct lp_ring_sample sample = {0};

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		sample.illuminance_lux[k] = daemon->options->ring_lux.values[k];
		sample.sigma_relative[k] = daemon->options->ring_sigma;
	}
	lp_worker_ring(daemon->worker, &sample);
}

static int create_worker(struct lp_daemon *daemon)
{
	struct lp_pipeline_options options = lp_options_pipeline(daemon->options);
	struct lp_pipeline *pipeline;
	int ret;

	options.camera = daemon->camera_file;
	if (isnan(options.scale.lux_per_unit) && daemon->camera_file->cd_m2_per_unit > 0.0F)
		options.scale = (struct lp_ring_scale){daemon->camera_file->cd_m2_per_unit,
						       daemon->camera_file->cd_m2_per_unit_sigma};
	lp_ring_only_init(&daemon->ring_only, &options.scale, options.smoothing_ms, options.ttl_ms,
			  lp_clock_ns());
	ret = lp_pipeline_create(&options, &pipeline);
	if (ret == 0)
		ret = lp_worker_create(pipeline, daemon->options->once, &daemon->worker);
	if (ret == 0 && daemon->options->ring_lux.count)
		give_ring_lux(daemon);
	return ret;
}

/* Everything that can be wrong in what the user wrote shows here. */
static int create_all(struct lp_daemon *daemon)
{
	int ret;

	if (daemon->options->ring_lux.count && !daemon->options->once) {
		lp_error("lightprobed", "--ring-lux",
			 "belongs to pictures read with --once — a ring that is there is --ring");
		return -EINVAL;
	}
	lp_health_init(&daemon->health, lp_clock_ns());
	lp_governor_init(&daemon->governor, &daemon->options->goals, daemon->options->preset,
			 lp_clock_ns(), lp_clock_cpu_ns());
	ret = lp_camera_file_read(daemon->options->camera, &daemon->camera_file);
	if (ret == 0)
		ret = create_source(daemon);
	if (ret == 0)
		ret = create_instruments(daemon);
	if (ret == 0)
		ret = create_orientation(daemon);
	if (ret == 0)
		set_name(daemon);
	if (ret == 0)
		ret = create_hub(daemon);
	if (ret == 0)
		ret = create_publishers(daemon);
	if (ret == 0)
		ret = create_worker(daemon);
	return ret;
}

/* In this order: frames go back before their source, packets before their hub. */
static void destroy_all(struct lp_daemon *daemon)
{
	lp_timer_stop(&daemon->tick);
	lp_watch_stop(&daemon->results);
	if (daemon->sensor)
		daemon->sensor->ops->destroy(daemon->sensor);
	lp_instruments_destroy(daemon->instruments);
	lp_worker_destroy(daemon->worker);
	for (int i = 0; i < daemon->publisher_count; i++)
		daemon->publishers[i]->ops->destroy(daemon->publishers[i]);
	if (daemon->source)
		daemon->source->ops->destroy(daemon->source);
	lp_hub_destroy(daemon->hub);
	lp_time_control_destroy(daemon->time_control);
	lp_loop_destroy(daemon->loop);
	lp_camera_file_destroy(daemon->camera_file);
	lp_log_flush(1);
}

/* Signals first, so that whatever has been opened is closed; publishers before the source: whoever
 * waits for the service finds them open. Who fails says why, but for the loop. */
static int start_all(struct lp_daemon *daemon)
{
	int ret = lp_loop_on_end(daemon->loop, on_signal, daemon);

	if (ret == 0)
		ret = lp_watch_start(daemon->loop, &daemon->results, lp_worker_fd(daemon->worker),
				     LP_READABLE, on_result);
	lp_timer_init(daemon->loop, &daemon->tick, on_tick);
	lp_timer_set(&daemon->tick, TICK_NS, TICK_NS);
	if (ret < 0) {
		lp_error("lightprobed", "loop", "%s", lp_strerror(ret));
		return ret;
	}
	for (int i = 0; i < daemon->publisher_count && ret == 0; i++)
		ret = daemon->publishers[i]->ops->start(daemon->publishers[i]);
	if (ret == 0 && daemon->sensor)
		ret = daemon->sensor->ops->start(daemon->sensor);
	if (ret == 0)
		ret = lp_instruments_start(daemon->instruments);
	return ret == 0 && daemon->source ? daemon->source->ops->start(daemon->source) : ret;
}

static int create_loop(struct lp_daemon *daemon)
{
	const int ret = lp_loop_create(&daemon->loop);

	if (ret < 0)
		lp_error("lightprobed", "loop", "%s", lp_strerror(ret));
	return ret;
}

static int simulate_time(struct lp_daemon *daemon)
{
	const char *path = daemon->options->simulated_time;

	return *path ? lp_time_control_create(path, daemon->loop, &daemon->time_control) : 0;
}

/* Until the end; sets the exit code. */
static void run_all(struct lp_daemon *daemon)
{
	if (create_all(daemon) < 0)
		return;
	daemon->exit_code = LP_EXIT_FAILURE;
	if (start_all(daemon) < 0)
		return;
	daemon->watchdog_ns = lp_service_watchdog_ns();
	lp_service_ready();
	lp_loop_run(daemon->loop);
}

int lp_daemon_run(const struct lp_options *options)
{
	struct lp_daemon daemon = {.options = options, .exit_code = LP_EXIT_FAILURE};

	if (create_loop(&daemon) == 0 && simulate_time(&daemon) == 0) {
		daemon.exit_code = LP_EXIT_USAGE;
		run_all(&daemon);
	}
	destroy_all(&daemon);
	return daemon.exit_code;
}
int lp_daemon_check(const struct lp_options *options)
{
	struct lp_daemon daemon = {.options = options};
	int ret = create_loop(&daemon);

	if (ret == 0)
		ret = create_all(&daemon);
	destroy_all(&daemon);
	return ret == 0 ? LP_EXIT_OK : LP_EXIT_USAGE;
}
