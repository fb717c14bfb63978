/* SPDX-License-Identifier: Apache-2.0 */
#include "app/daemon_parts.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>

#include "app/run/service.h"
#include "base/clock.h"
#include "base/log.h"
#include "include/frame.h"

#define TICK_NS (100 * LP_NS_PER_MS)
#define EXPIRES_SOON_NS (14 * 24 * 3600 * LP_NS_PER_S)
#define DRAIN_NS (5 * LP_NS_PER_S) /* how long the last packets may take to leave */

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

void lp_daemon_begin_ending(struct lp_daemon *daemon, enum lp_exit exit_code)
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
	lp_daemon_begin_ending(daemon, daemon->options->once ? LP_EXIT_FAILURE : LP_EXIT_OK);
	lp_loop_stop(daemon->loop);
}

/* ---------------------------------------------------------------- from the source */

void lp_daemon_on_stamped_frame(void *context, struct lp_frame *frame)
{
	struct lp_daemon *daemon = context;
	const struct lp_demand demand = lp_hub_demand(daemon->hub);

	lp_orientation_frame(&daemon->orientation, frame);
	/* Simulated time stands still while a frame is at work. */
	if (lp_worker_submit(daemon->worker, frame, &demand))
		lp_loop_hold(daemon->loop);
}

void lp_daemon_on_ring(void *context, const struct lp_ring_sample *sample)
{
	static const struct lp_demand all = {.sh_order = LP_MAX_SH_ORDER,
					     .max_lights = LP_MAX_LIGHTS};
	struct lp_daemon *daemon = context;

	if (lp_worker_ring(daemon->worker, sample))
		lp_loop_hold(daemon->loop);
	if (!lp_ring_only_sample(&daemon->ring_only, sample, lp_clock_ns(),
				 &daemon->ring_estimates))
		return;
	daemon->ring_estimates.raw.flags |= lp_instruments_flags(daemon->instruments);
	daemon->ring_estimates.smoothed.flags = daemon->ring_estimates.raw.flags;
	lp_hub_publish(daemon->hub, &daemon->ring_estimates, &all);
}

/* Whoever has it has logged it. */
void lp_daemon_on_fault(void *context, const char *id, const char *text)
{
	struct lp_daemon *daemon = context;

	lp_health_fault(&daemon->health, id, text);
}

/* ---------------------------------------------------------------- from the worker */

/* The set is complete: publish its estimate and end. */
static void finish_once(struct lp_daemon *daemon)
{
	struct lp_light_estimate *raw = &daemon->once_best.estimates.raw;

	if (!daemon->once_has_best) {
		lp_error("lightprobed", "once", "no picture gave an estimate (see above)");
		lp_daemon_begin_ending(daemon, LP_EXIT_FAILURE);
		return;
	}
	if (lp_worker_rejected(daemon->worker) + daemon->frames_corrupt > 0)
		raw->flags |= LP_ESTIMATE_BRACKET_INCOMPLETE;
	raw->flags |= lp_ring_watch_once(&daemon->once_best.estimates.ring);
	lp_hub_publish(daemon->hub, &daemon->once_best.estimates, &daemon->once_best.demand);
	lp_daemon_begin_ending(daemon, LP_EXIT_OK);
}

/* All cameras have told what they have to. An endless one has no last frame: its first estimate
 * counts. */
static bool all_told(struct lp_daemon *daemon, const struct lp_result *result)
{
	struct lp_daemon_camera *camera = &daemon->cameras[result->camera];
	bool all = true;

	camera->told |= result->last_frame || (!camera->caps.finite && result->status == 0);
	for (int k = 0; k < daemon->camera_count; k++)
		all &= daemon->cameras[k].told;
	return all;
}

static void take_once(struct lp_daemon *daemon, const struct lp_result *result)
{
	if (daemon->ending_ns)
		return;
	if (result->status == 0) {
		daemon->once_best = *result;
		daemon->once_best.estimates.surroundings = &daemon->once_best.surroundings;
		daemon->once_has_best = true;
	}
	if (all_told(daemon, result))
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
	daemon->health.report.places_left_out = (uint32_t)result->estimates.places_left_out;
	lp_instruments_see(daemon->instruments, &result->estimates.raw);
	lp_orientation_judged(&daemon->orientation, &result->estimates.raw.orientation);
	result->estimates.smoothed.orientation = result->estimates.raw.orientation;
	lp_ring_only_camera(&daemon->ring_only, &result->estimates.raw, lp_clock_ns());
	lp_hub_publish(daemon->hub, &result->estimates, &result->demand);
	if (result->has_polarization)
		lp_hub_publish_polarization(daemon->hub, &result->polarization);
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
	for (int k = 0; k < daemon->camera_count; k++) {
		struct lp_source *source = daemon->cameras[k].source;

		if (!isnan(result->commands_us[k]))
			(void)source->ops->set_exposure(source, result->commands_us[k], 1.0F);
	}
	if (daemon->options->once)
		take_once(daemon, result);
	else if (result->status == 0)
		publish(daemon, result);
	lp_worker_give(daemon->worker, result);
	continue_ending(daemon);
}

/* ---------------------------------------------------------------- descriptors and time */

/* A `once` set whose reader left before its estimate has failed. */
void lp_daemon_on_publisher_failed(void *context, int failure)
{
	struct lp_daemon *daemon = context;

	lp_daemon_begin_ending(daemon, failure == -EPIPE && !daemon->options->once
					       ? LP_EXIT_OK
					       : LP_EXIT_FAILURE);
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

static const char *const certificate_texts[] = {
	[LP_EXPIRES_SOON] = "the certificate expires within 14 days — run lightprobe pair --new, "
			    "restart lightprobed, and give clients the new address",
	[LP_EXPIRED] = "the certificate has expired: browsers refuse it — run lightprobe pair "
		       "--new, restart lightprobed, and give clients the new address",
};

/* A certificate that ends while the daemon runs keeps new clients away; they cannot tell us. */
static void watch_certificates(struct lp_daemon *daemon)
{
	const int64_t now_ns = lp_clock_unix_ns(lp_clock_ns());
	enum lp_validity validity = LP_VALID;
	const char *waits_for = NULL;

	for (int i = 0; i < daemon->publisher_count; i++) {
		const int64_t end_ns = daemon->publishers[i]->t_expires_unix_ns;

		if (daemon->publishers[i]->waits_for)
			waits_for = daemon->publishers[i]->waits_for;
		if (end_ns && now_ns > end_ns)
			validity = LP_EXPIRED;
		else if (end_ns && now_ns > end_ns - EXPIRES_SOON_NS && validity == LP_VALID)
			validity = LP_EXPIRES_SOON;
	}
	if (waits_for != daemon->waits_for) {
		daemon->waits_for = waits_for;
		lp_health_fault(&daemon->health, "publisher-waits", waits_for);
	}
	if (validity == daemon->validity)
		return;
	daemon->validity = validity;
	lp_health_fault(&daemon->health, "certificate-expires", certificate_texts[validity]);
	if (validity != LP_VALID)
		lp_warning("lightprobed", "certificate", "%s", certificate_texts[validity]);
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
	watch_certificates(daemon);
	lp_hub_tick(daemon->hub);
	feed_watchdog(daemon);
	lp_log_flush(0);
	continue_ending(daemon);
}

int lp_daemon_on_sweep(void *context, uint64_t *done_at, const char **reason)
{
	struct lp_daemon *daemon = context;

	return lp_instruments_sweep(daemon->instruments, done_at, reason);
}

/* ---------------------------------------------------------------- orientation */

int lp_daemon_on_pose(void *context, const void *client, const struct lp_orientation_sample *sample)
{
	struct lp_daemon *daemon = context;

	return lp_orientation_pose(&daemon->orientation, client, sample);
}

void lp_daemon_on_client_left(void *context, const void *client)
{
	struct lp_daemon *daemon = context;

	lp_orientation_client_left(&daemon->orientation, client);
}

void lp_daemon_on_orientation_sample(void *context, const struct lp_orientation_sample *sample)
{
	struct lp_daemon *daemon = context;

	lp_orientation_sensed(&daemon->orientation, sample);
}

/* ---------------------------------------------------------------- life */

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
	return ret == 0 ? lp_daemon_start_cameras(daemon) : ret;
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
	if (lp_daemon_create_parts(daemon) < 0)
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
	lp_daemon_destroy_parts(&daemon);
	return daemon.exit_code;
}

int lp_daemon_check(const struct lp_options *options)
{
	struct lp_daemon daemon = {.options = options};
	int ret = create_loop(&daemon);

	if (ret == 0)
		ret = lp_daemon_create_parts(&daemon);
	lp_daemon_destroy_parts(&daemon);
	return ret == 0 ? LP_EXIT_OK : LP_EXIT_USAGE;
}
