/* SPDX-License-Identifier: Apache-2.0 */
#include "app/daemon_parts.h"

#include <errno.h>
#include <math.h>
#include <sys/random.h>
#include <unistd.h>
#include <string.h>

#include "app/backends.h"
#include "app/options/film_options.h"
#include "app/rig.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/text.h"
#include "include/ring_sample.h"

#define INSECURE_LAN                                                             \
	"lightprobed: --insecure-lan: anyone on the network can read the light " \
	"— publish on wss: instead (lightprobe pair)"

static void set_name(struct lp_daemon *daemon)
{
	char host[sizeof(daemon->name)] = "";

	(void)gethostname(host, sizeof(host) - 1);
	lp_text_copy(daemon->name, sizeof(daemon->name),
		     *daemon->options->name ? daemon->options->name : host);
}

static int create_orientation(struct lp_daemon *daemon)
{
	const struct lp_pipeline_options pipeline = lp_options_pipeline(daemon->options);
	const struct lp_orientation_host host = {.context = daemon,
						 .loop = daemon->loop,
						 .sample = lp_daemon_on_orientation_sample,
						 .fault = lp_daemon_on_fault};
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
		.hello = {.source = daemon->camera_count
					    ? daemon->cameras[0].source->ops->info.scheme
					    : "none",
			  .preset = lp_preset_name(options->preset),
			  .max_sh_order = pipeline.sh_order,
			  .max_lights = pipeline.max_lights,
			  .smoothing_ms = (uint32_t)lrintf(options->smoothing_ms),
			  .has_wheel = *options->rotator,
			  .has_ring = *options->ring,
			  .name = daemon->name,
			  .orientation = lp_orientation_name((int)pipeline.orientation),
			  .max_reflection_size = pipeline.reflection_size,
			  .polarization_map = options->publish_polarization},
		.initial = lp_default_subscription(),
		.ttl_ms = (uint32_t)lrintf(options->ttl_ms),
		.max_clients = options->max_clients,
		.insecure_lan = options->insecure_lan,
		.health = &daemon->health,
		.loop = daemon->loop,
		.context = daemon,
		.pose = lp_daemon_on_pose,
		.left = lp_daemon_on_client_left,
		.sweep = lp_daemon_on_sweep,
		.stills = lp_daemon_on_stills,
		.failed = lp_daemon_on_publisher_failed,
	};

	if (getrandom(&hub.hello.boot_id, sizeof(hub.hello.boot_id), GRND_NONBLOCK) < 0)
		hub.hello.boot_id = (uint32_t)lp_clock_unix_ns(lp_clock_ns());
	if (options->once) {
		hub.lasts = true;
		/* One estimate of this set, as it is, with all that was asked for. */
		hub.initial.raw = true;
		hub.initial.sh_order = pipeline.sh_order;
		hub.initial.max_lights = pipeline.max_lights;
		hub.initial.area_lights = options->area_lights;
		hub.initial.key_light = options->key_light;
		hub.initial.reflection.size = pipeline.reflection_size;
		hub.initial.reflection.total = true;
	}
	daemon->health.report.preset = hub.hello.preset;
	return lp_hub_create(&hub, &daemon->hub);
}

/* Pictures leave the box only where its owner says so, and then the log says it, too. */
static int check_polarization(const struct lp_options *options)
{
	if (!options->publish_polarization)
		return 0;
	if (options->polarizer.mode != LP_POLARIZER_SWEEP) {
		lp_error("lightprobed", "--publish-polarization",
			 "only a film that is swept tells how light is polarized — add "
			 "--polarizer=sweep");
		return -EINVAL;
	}
	lp_warning("lightprobed", "--publish-polarization",
		   "every client may ask for coarse pictures of the room");
	return 0;
}

static int create_instruments(struct lp_daemon *daemon)
{
	const struct lp_instruments_host host = {.context = daemon,
						 .loop = daemon->loop,
						 .frame = lp_daemon_on_stamped_frame,
						 .ring = lp_daemon_on_ring};

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
	const struct lp_floats *sigma = &daemon->options->ring_sigma;
	struct lp_ring_sample sample = {0};

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		sample.illuminance_lux[k] = daemon->options->ring_lux.values[k];
		sample.sigma_relative[k] = sigma->values[k % sigma->count];
	}
	if (daemon->options->has_ring_rgb) {
		memcpy(sample.rgb, daemon->options->ring_rgb, sizeof(sample.rgb));
		sample.colour_sigma = daemon->options->ring_colour_sigma;
	}
	(void)lp_worker_ring(daemon->worker, &sample);
}

static int create_worker(struct lp_daemon *daemon)
{
	struct lp_pipeline_options options = lp_options_pipeline(daemon->options);
	/* light is on the scale of the first camera */
	const struct lp_camera_file *first = daemon->cameras[0].file;
	const int waiting = daemon->camera_count ? daemon->camera_count : 1;
	struct lp_pipeline *pipeline;
	int ret;

	options.camera_count = daemon->camera_count;
	for (int k = 0; k < LP_MAX_CAMERAS; k++)
		options.cameras[k] = daemon->cameras[k].file;
	options.rig_sigma_deg = lp_rig_sigma_deg(options.cameras, daemon->camera_count);
	options.film = lp_film_options(daemon->options, first);
	if (isnan(options.scale.lux_per_unit) && first->cd_m2_per_unit > 0.0F)
		options.scale =
			(struct lp_ring_scale){first->cd_m2_per_unit, first->cd_m2_per_unit_sigma};
	lp_ring_only_init(&daemon->ring_only, &options.scale, options.smoothing_ms, options.ttl_ms,
			  lp_clock_ns());
	ret = lp_pipeline_create(&options, &pipeline);
	if (ret == 0)
		ret = lp_worker_create(pipeline, daemon->options->once ? LP_ALL_FRAMES : waiting,
				       &daemon->worker);
	if (ret == 0 && daemon->options->ring_lux.count)
		give_ring_lux(daemon);
	return ret;
}

/* Everything that can be wrong in what the user wrote shows here. */
int lp_daemon_create_parts(struct lp_daemon *daemon)
{
	int ret;

	lp_health_init(&daemon->health, lp_clock_ns());
	lp_governor_init(&daemon->governor, &daemon->options->goals, daemon->options->preset,
			 lp_clock_ns(), lp_clock_cpu_ns());
	ret = check_polarization(daemon->options);
	if (ret == 0)
		ret = lp_daemon_create_cameras(daemon);
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
void lp_daemon_destroy_parts(struct lp_daemon *daemon)
{
	lp_timer_stop(&daemon->tick);
	lp_watch_stop(&daemon->results);
	if (daemon->sensor)
		daemon->sensor->ops->destroy(daemon->sensor);
	lp_instruments_destroy(daemon->instruments);
	lp_worker_destroy(daemon->worker);
	for (int i = 0; i < daemon->publisher_count; i++)
		daemon->publishers[i]->ops->destroy(daemon->publishers[i]);
	lp_daemon_destroy_sources(daemon);
	lp_hub_destroy(daemon->hub);
	lp_time_control_destroy(daemon->time_control);
	lp_loop_destroy(daemon->loop);
	lp_daemon_destroy_camera_files(daemon);
	lp_log_flush(1);
}
