/* SPDX-License-Identifier: Apache-2.0 */
#include "serve/codec/codec.h"

#include <assert.h>
#include <errno.h>
#include <math.h>
#include <pb_encode.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/macros.h"
#include "base/text.h"
#include "include/packet.h"
#include "include/polarization_grid.h"
#include "include/processing.h"
#include "light/send/key.h"
#include "light/send/model.h"
#include "proto/lightprobe.pb.h"
#include "proto/ranges.h"
#include "serve/codec/codec_fields.h"
#include "serve/health.h"

#define PROTOCOL_MAJOR 1
/* 1: estimates echo the number of their subscription. 2: Hello names the probe. 3: poses, pings,
 * WORLD and the probe's orientation; KEY and area lights. 4: reflection maps; polarization maps,
 * sweeps on request. 5: stills on request. 6: subscriptions by what is drawn. */
#define PROTOCOL_MINOR 6
#define LEAST_SLEEP_NS (50 * LP_NS_PER_MS) /* less may be the reading of two clocks */
#define LENGTH_PREFIX_BYTES 3		   /* of messages up to 2 MiB */
/* What FromProbe adds to the message in it: its tag and its length. */
#define ENVELOPE_BYTES (1 + LENGTH_PREFIX_BYTES + LENGTH_PREFIX_BYTES)

#define FITS(message)                                                                         \
	static_assert(lightprobe_v1_##message##_size + ENVELOPE_BYTES <= LP_PACKET_MAX_BYTES, \
		      "a packet holds the largest " #message)
FITS(Hello);
FITS(Estimate);
FITS(Health);
FITS(Error);
FITS(Pong);
FITS(SweepStarted);
static_assert(lightprobe_v1_PolarizationMap_size + ENVELOPE_BYTES <= LP_PACKET_LARGE_BYTES,
	      "a picture's packet holds the largest PolarizationMap");
static_assert(sizeof(((struct lp_polarization_grid *)NULL)->cells) ==
		      sizeof(((lightprobe_v1_PolarizationMap_cells_t *)NULL)->bytes),
	      "as many cells as the wire holds");

/* The headers' states are the wire's. */
#define SAME(ours, wire) static_assert((int)(ours) == (int)(lightprobe_v1_##wire), #ours)
SAME(LP_WHEEL_UNKNOWN, Wheel_Phase_UNKNOWN);
SAME(LP_WHEEL_HOMING, Wheel_Phase_HOMING);
SAME(LP_WHEEL_MOVING, Wheel_Phase_MOVING);
SAME(LP_WHEEL_SETTLED, Wheel_Phase_SETTLED);
SAME(LP_WHEEL_FAULT, Wheel_Phase_FAULT);
SAME(LP_WHEEL_ABSENT, Wheel_Phase_ABSENT);
SAME(LP_SOURCE_DOWN, Health_SourceState_DOWN);
SAME(LP_SOURCE_WAITING, Health_SourceState_WAITING);
SAME(LP_SOURCE_STREAMING, Health_SourceState_STREAMING);
SAME(LP_SOURCE_STALLED, Health_SourceState_STALLED);
SAME(LP_SOURCE_ENDED, Health_SourceState_ENDED);
static_assert(LP_MAX_FAULTS * sizeof(lightprobe_v1_Fault) ==
		      sizeof(((lightprobe_v1_Health *)NULL)->faults),
	      "as many faults as the wire holds");

static const char *name_of(const lightprobe_v1_FromProbe *message)
{
	static const char *const names[] = {
		[lightprobe_v1_FromProbe_hello_tag] = "hello",
		[lightprobe_v1_FromProbe_estimate_tag] = "estimate",
		[lightprobe_v1_FromProbe_health_tag] = "health",
		[lightprobe_v1_FromProbe_error_tag] = "error",
		[lightprobe_v1_FromProbe_pong_tag] = "pong",
		[lightprobe_v1_FromProbe_polarization_map_tag] = "polarization_map",
		[lightprobe_v1_FromProbe_sweep_started_tag] = "sweep_started",
		[lightprobe_v1_FromProbe_stills_asked_tag] = "stills_asked",
	};

	return names[message->which_message];
}

static void encode(const lightprobe_v1_FromProbe *message, enum lp_packet_kind kind,
		   struct lp_packet *packet)
{
	pb_ostream_t stream = pb_ostream_from_buffer(packet->data, packet->capacity_bytes);
	const bool done = pb_encode_delimited(&stream, lightprobe_v1_FromProbe_fields, message);

	assert(done); /* every field is bounded, and the buffer holds them all */
	(void)done;
	packet->kind = kind;
	packet->name = name_of(message);
	packet->size_bytes = (uint32_t)stream.bytes_written;
}

int lp_may_be_sent(const char *forbidden)
{
	if (!forbidden)
		return 0;
	lp_error("hub", "encode", "%s; the message is not sent", forbidden);
	return -ERANGE;
}

/* A ratio as a whole number of `parts`; false when it is not known. */
static bool scaled(float ratio, float parts, uint32_t *value)
{
	if (isnan(ratio))
		return false;
	*value = (uint32_t)fminf(fmaxf(roundf(ratio * parts), 0.0F), 1e6F);
	return true;
}

/* A sigma as whole permille, never less than it is; false when it is not known. */
static bool scaled_up(float sigma, uint32_t *permille)
{
	return scaled(ceilf(sigma * 1000.0F), 1, permille);
}

static bool known(float value, float *field)
{
	if (!isfinite(value))
		return false;
	*field = value;
	return true;
}

static void fill_polarization(lightprobe_v1_Light *wire, const struct lp_light_polarization *p)
{
	wire->has_dolp_percent = p->known && scaled(p->dolp, 100, &wire->dolp_percent);
	wire->has_dolp_sigma_permille =
		p->known && scaled(p->dolp_sigma, 1000, &wire->dolp_sigma_permille);
	wire->has_aolp_deg = p->known && known(p->aolp_deg, &wire->aolp_deg);
	wire->has_aolp_sigma_deg = p->known && known(p->aolp_sigma_deg, &wire->aolp_sigma_deg);
	wire->has_reflection_percent =
		p->judged && scaled(p->reflection, 100, &wire->reflection_percent);
}

/* `upward`: lp_upward_irradiance() of the estimate. */
static void fill_light(lightprobe_v1_Light *wire, const struct lp_light *light, float upward)
{
	wire->id = light->id;
	wire->flags = light->flags;
	wire->direction_count = 3;
	wire->irradiance_count = 3;
	wire->has_direction_sigma_deg =
		known(light->direction_sigma_deg, &wire->direction_sigma_deg);
	wire->has_irradiance_sigma_permille =
		scaled(light->irradiance_sigma, 1000, &wire->irradiance_sigma_permille);
	wire->has_colour_sigma_permille =
		light->colour_sigma > 0.0F &&
		scaled(light->colour_sigma, 1000, &wire->colour_sigma_permille);
	wire->has_shadow_strength_permille =
		scaled(lp_shadow_strength(light, upward), 1000, &wire->shadow_strength_permille);
	wire->has_distance_m = known(light->distance_m, &wire->distance_m);
	wire->has_distance_sigma_permille =
		wire->has_distance_m &&
		scaled(light->distance_sigma, 1000, &wire->distance_sigma_permille);
	wire->has_nearest_m = light->nearest_m > 0.0F && known(light->nearest_m, &wire->nearest_m);
	if (light->flags & LP_LIGHT_EXTENDED) {
		wire->half_angle_deg_count = 2;
		wire->axis_count = 3;
		memcpy(wire->half_angle_deg, light->half_angle_deg, sizeof(light->half_angle_deg));
		memcpy(wire->axis, light->axis, sizeof(light->axis));
	}
	fill_polarization(wire, &light->polarization);
	memcpy(wire->direction, light->direction, sizeof(light->direction));
	memcpy(wire->irradiance, light->irradiance, sizeof(light->irradiance));
	wire->angular_radius_deg = light->angular_radius_deg;
}

/* KEY of what the listed lights leave. */
static struct lp_light key_of(const struct lp_light_estimate *estimate,
			      const struct lp_variant *variant)
{
	float ambient[LP_SH_COUNT(1)][3];

	lp_model_ambient(estimate, 1, variant->lights, ambient);
	return lp_key_light((const float(*)[3])ambient);
}

static void fill_sh(lightprobe_v1_SphericalHarmonics *wire,
		    const struct lp_light_estimate *estimate, const struct lp_variant *variant,
		    const struct lp_light *key)
{
	float ambient[LP_MAX_SH_COUNT][3];
	const float(*coefficients)[3] = estimate->sh_total;
	const int values = 3 * LP_SH_COUNT(variant->sh_order);

	if (!variant->total) {
		lp_model_ambient(estimate, variant->sh_order, variant->lights, ambient);
		if (key)
			lp_key_remove(variant->sh_order, key, ambient);
		coefficients = (const float(*)[3])ambient;
	}
	wire->kind = variant->total ? lightprobe_v1_SphericalHarmonics_Kind_TOTAL
				    : lightprobe_v1_SphericalHarmonics_Kind_AMBIENT;
	wire->order = (uint32_t)variant->sh_order;
	wire->coefficients_count = (pb_size_t)values;
	memcpy(wire->coefficients, coefficients[0], (size_t)values * sizeof(float));
}

static void fill_orientation(lightprobe_v1_Estimate *wire,
			     const struct lp_estimate_orientation *orientation)
{
	if (!orientation->known)
		return;
	wire->orientation_count = 4;
	wire->has_orientation_sigma_deg =
		known(orientation->sigma_deg, &wire->orientation_sigma_deg);
	memcpy(wire->orientation, orientation->xyzw, sizeof(orientation->xyzw));
	if (!orientation->has_position)
		return;
	wire->position_count = 3;
	memcpy(wire->position, orientation->position_m, sizeof(orientation->position_m));
}

/* A room that may not be sent is left out: the light is worth more than it. So is one through which
 * these SH are better not moved: their error is INFINITY. */
static void fill_room(lightprobe_v1_Estimate *wire, const struct lp_light_estimate *estimate,
		      const struct lp_variant *variant)
{
	const struct lp_estimate_room *const room = &estimate->room;
	/* The SH are without area lights where these are listed: they come last. */
	const bool is_bare = estimate->area_count && variant->lights == estimate->light_count;
	const float error_per_m =
		(is_bare ? room->bare_error_per_m : room->error_per_m)[variant->sh_order];
	lightprobe_v1_Room *const to = &wire->room;

	if (!room->known || !isfinite(error_per_m) ||
	    !scaled_up(error_per_m, &to->error_permille_per_m))
		return;
	to->walls_m_count = 6;
	to->walls_sigma_m_count = 6;
	to->orientation_count = 4;
	memcpy(to->walls_m, room->walls_m, sizeof(room->walls_m));
	memcpy(to->walls_sigma_m, room->walls_sigma_m, sizeof(room->walls_sigma_m));
	memcpy(to->orientation, room->xyzw, sizeof(room->xyzw));
	wire->has_room = !lp_keep_Room(to);
}

/* How long the machine was suspended since the estimate was made. */
static int64_t slept_since(const struct lp_light_estimate *estimate)
{
	const int64_t slept_ns = lp_clock_suspended_ns() - estimate->suspended_ns;

	return slept_ns > LEAST_SLEEP_NS ? slept_ns : 0;
}

int lp_encode_estimate(const struct lp_light_estimate *estimate, const struct lp_variant *variant,
		       const struct lp_stamp *stamp, struct lp_packet *packet)
{
	lightprobe_v1_FromProbe message = {.which_message = lightprobe_v1_FromProbe_estimate_tag};
	lightprobe_v1_Estimate *wire = &message.message.estimate;
	const int64_t slept_ns = slept_since(estimate);
	const float upward = lp_upward_irradiance(estimate);
	struct lp_light key;
	const int64_t delay_us =
		(stamp->t_send_ns - estimate->t_capture_ns + slept_ns) / LP_NS_PER_US;

	wire->sequence = estimate->sequence;
	wire->boot_id = stamp->boot_id;
	wire->capture_time_unix_ns =
		(uint64_t)(lp_clock_unix_ns(estimate->t_capture_ns) - slept_ns);
	/* 71 minutes and more read as 71 minutes. */
	wire->send_delay_us = delay_us < 0	      ? 0
			      : delay_us > UINT32_MAX ? UINT32_MAX
						      : (uint32_t)delay_us;
	wire->ttl_ms = stamp->ttl_ms + stamp->quiet_ms;
	wire->subscription = stamp->subscription;
	wire->flags = estimate->flags;
	if (!stamp->lasts && delay_us * LP_NS_PER_US > stamp->ttl_ms * LP_NS_PER_MS)
		wire->flags |= LP_ESTIMATE_STALE;
	if (estimate->light_count - estimate->area_count > variant->lights)
		wire->flags |= LP_ESTIMATE_MORE_LIGHTS;
	wire->has_predicted_error_permille =
		scaled(estimate->predicted_error[variant->sh_order][variant->lights], 1000,
		       &wire->predicted_error_permille);
	wire->has_relighting_sigma_permille =
		scaled(estimate->relighting_sigma, 1000, &wire->relighting_sigma_permille);
	wire->has_drawn = variant->has_drawn && lp_fill_drawn(&wire->drawn, &variant->drawn);
	wire->has_exposure_us = isfinite(estimate->exposure_us);
	if (wire->has_exposure_us)
		wire->exposure_us = (uint32_t)fminf(fmaxf(roundf(estimate->exposure_us), 0), 4e9F);
	wire->exposure_count = (uint32_t)estimate->exposure_count;
	wire->has_scale_sigma_permille =
		scaled(estimate->scale_sigma, 1000, &wire->scale_sigma_permille);
	wire->has_cd_m2_per_unit = known(estimate->cd_m2_per_unit, &wire->cd_m2_per_unit);
	wire->has_cd_m2_per_unit_sigma_permille =
		wire->has_cd_m2_per_unit &&
		scaled(estimate->cd_m2_per_unit_sigma, 1000, &wire->cd_m2_per_unit_sigma_permille);
	/* An angle without its uncertainty is of no use. */
	wire->has_wheel_sigma_deg = known(estimate->wheel_sigma_deg, &wire->wheel_sigma_deg);
	wire->has_wheel_deg =
		wire->has_wheel_sigma_deg && known(estimate->wheel_deg, &wire->wheel_deg);
	fill_orientation(wire, &estimate->orientation);
	fill_room(wire, estimate, variant);
	wire->frame = variant->world ? lightprobe_v1_Estimate_Frame_WORLD
				     : lightprobe_v1_Estimate_Frame_PROBE;
	wire->has_sh = true;
	wire->lights_count = (pb_size_t)variant->lights;
	for (int i = 0; i < variant->lights; i++)
		fill_light(&wire->lights[i], &estimate->lights[i], upward);
	wire->has_key = variant->key;
	if (variant->key) {
		key = key_of(estimate, variant);
		fill_light(&wire->key, &key, upward);
	}
	fill_sh(&wire->sh, estimate, variant, variant->key ? &key : NULL);
	if (lp_may_be_sent(lp_keep_Estimate(wire)) != 0)
		return -ERANGE;
	encode(&message, LP_PACKET_STATE, packet);
	return 0;
}

/* All text enters the wire here: a strict client refuses a whole message for one bad byte. */
#define COPY_TEXT(field, text) lp_text_copy(field, sizeof(field), text)

static void fill_processing(lightprobe_v1_Hello *wire, uint32_t processing_on)
{
	_Static_assert(LP_PROCESSING_KINDS <= LP_COUNT(wire->processing), "a place for each");
	for (int kind = 0; kind < LP_PROCESSING_KINDS; kind++) {
		if (!(processing_on & LP_PROCESSING_BIT(kind)))
			continue;
		COPY_TEXT(wire->processing[wire->processing_count], lp_processing_name(kind));
		wire->processing_count++;
	}
}

void lp_encode_hello(const struct lp_hello *hello, struct lp_packet *packet)
{
	lightprobe_v1_FromProbe message = {.which_message = lightprobe_v1_FromProbe_hello_tag};
	lightprobe_v1_Hello *wire = &message.message.hello;

	wire->protocol_major = PROTOCOL_MAJOR;
	wire->protocol_minor = PROTOCOL_MINOR;
	COPY_TEXT(wire->software, "lightprobed " LP_VERSION);
	wire->boot_id = hello->boot_id;
	COPY_TEXT(wire->source, hello->source);
	wire->max_sh_order = (uint32_t)hello->max_sh_order;
	wire->max_lights = (uint32_t)hello->max_lights;
	wire->smoothing_time_constant_ms = hello->smoothing_ms;
	COPY_TEXT(wire->clock, "CLOCK_REALTIME");
	COPY_TEXT(wire->preset, hello->preset);
	wire->has_wheel = hello->has_wheel;
	wire->has_ring = hello->has_ring;
	COPY_TEXT(wire->name, hello->name);
	wire->insecure_lan = hello->insecure_lan;
	COPY_TEXT(wire->orientation, hello->orientation ? hello->orientation : "");
	wire->max_reflection_map_size = (uint32_t)hello->max_reflection_size;
	wire->polarization_map = hello->polarization_map;
	fill_processing(wire, hello->processing_on);
	encode(&message, LP_PACKET_CONTROL, packet);
}

static void fill_wheel(lightprobe_v1_Wheel *wire, const struct lp_wheel_report *wheel)
{
	const struct lp_wheel_state *state = &wheel->state;

	wire->phase = (lightprobe_v1_Wheel_Phase)state->phase;
	wire->has_commanded_deg = known(state->commanded_deg, &wire->commanded_deg);
	wire->has_measured_deg = known(state->measured_deg, &wire->measured_deg);
	wire->has_sigma_deg = known(state->sigma_deg, &wire->sigma_deg);
	wire->moves = wheel->moves;
	wire->frames_stamped = wheel->frames_stamped;
	wire->frames_moving = wheel->frames_moving;
	wire->frames_unknown = wheel->frames_unknown;
	wire->has_clock_sigma_us = known(state->clock_sigma_us, &wire->clock_sigma_us);
	wire->reconnects = state->reconnects;
	wire->sweeps = wheel->sweeps;
}

static void fill_ring(lightprobe_v1_Ring *wire, const struct lp_ring_report *ring)
{
	wire->illuminance_lux_count = LP_RING_SENSORS;
	memcpy(wire->illuminance_lux, ring->illuminance_lux, sizeof(ring->illuminance_lux));
	wire->samples_per_s = ring->samples_per_s;
	wire->samples = ring->samples;
	wire->samples_lost = ring->samples_lost;
}

int lp_encode_health(const struct lp_health_report *report, struct lp_packet *packet)
{
	lightprobe_v1_FromProbe message = {.which_message = lightprobe_v1_FromProbe_health_tag};
	lightprobe_v1_Health *wire = &message.message.health;

	wire->uptime_ms = report->uptime_ms;
	wire->source_state = (lightprobe_v1_Health_SourceState)report->source_state;
	wire->frames_received = report->frames_received;
	wire->frames_dropped = report->frames_dropped;
	wire->frames_rejected = report->frames_rejected;
	wire->source_reconnects = report->source_reconnects;
	wire->estimates = report->estimates;
	wire->estimates_per_s = report->estimates_per_s;
	wire->latency_p50_us = report->latency_p50_us;
	wire->latency_p99_us = report->latency_p99_us;
	wire->clients = report->clients;
	wire->packets_sent = report->packets_sent;
	wire->packets_superseded = report->packets_superseded;
	wire->requests_rejected = report->requests_rejected;
	wire->cpu_percent = report->cpu_percent;
	wire->rss_kib = report->rss_kib;
	COPY_TEXT(wire->preset, report->preset ? report->preset : "");
	wire->has_wheel = report->has_wheel;
	fill_wheel(&wire->wheel, &report->wheel);
	wire->has_ring = report->has_ring;
	fill_ring(&wire->ring, &report->ring);
	wire->polarization_maps_sent = report->polarization_maps_sent;
	wire->places_left_out = report->places_left_out;
	wire->faults_count = (pb_size_t)report->fault_count;
	for (int i = 0; i < report->fault_count; i++) {
		COPY_TEXT(wire->faults[i].id, report->faults[i].id);
		COPY_TEXT(wire->faults[i].text, report->faults[i].text);
	}
	if (lp_may_be_sent(lp_keep_Health(wire)) != 0)
		return -ERANGE;
	encode(&message, LP_PACKET_CONTROL, packet);
	return 0;
}

void lp_encode_pong(const struct lp_pong *pong, struct lp_packet *packet)
{
	lightprobe_v1_FromProbe message = {.which_message = lightprobe_v1_FromProbe_pong_tag};
	lightprobe_v1_Pong *wire = &message.message.pong;

	wire->ping_time_ns = pong->ping_time_ns;
	wire->received_unix_ns = (uint64_t)lp_clock_unix_ns(pong->t_received_ns);
	wire->sent_unix_ns = (uint64_t)lp_clock_unix_ns(pong->t_sent_ns);
	encode(&message, LP_PACKET_CONTROL, packet);
}

int lp_encode_polarization(const struct lp_polarization_grid *grid, uint64_t sweeps,
			   struct lp_packet *packet)
{
	lightprobe_v1_FromProbe message = {.which_message =
						   lightprobe_v1_FromProbe_polarization_map_tag};
	lightprobe_v1_PolarizationMap *wire = &message.message.polarization_map;

	wire->capture_time_unix_ns = (uint64_t)lp_clock_unix_ns(grid->t_capture_ns);
	wire->width = LP_POLARIZATION_WIDTH;
	wire->height = LP_POLARIZATION_HEIGHT;
	wire->s0_unit = grid->s0_unit;
	wire->sweeps = sweeps;
	wire->cells.size = sizeof(grid->cells);
	for (size_t i = 0; i < sizeof(grid->cells) / 2; i++) {
		const uint16_t half = grid->cells[i / 4][i % 4];

		wire->cells.bytes[2 * i] = (uint8_t)half;
		wire->cells.bytes[2 * i + 1] = (uint8_t)(half >> 8);
	}
	if (lp_may_be_sent(lp_keep_PolarizationMap(wire)) != 0)
		return -ERANGE;
	encode(&message, LP_PACKET_PICTURE, packet);
	return 0;
}

void lp_encode_sweep_started(uint64_t done_at, struct lp_packet *packet)
{
	lightprobe_v1_FromProbe message = {.which_message =
						   lightprobe_v1_FromProbe_sweep_started_tag};

	message.message.sweep_started.done_at = done_at;
	encode(&message, LP_PACKET_CONTROL, packet);
}

void lp_encode_stills_asked(uint32_t cameras, struct lp_packet *packet)
{
	lightprobe_v1_FromProbe message = {.which_message =
						   lightprobe_v1_FromProbe_stills_asked_tag};

	message.message.stills_asked.cameras = cameras;
	encode(&message, LP_PACKET_CONTROL, packet);
}

void lp_encode_error(int code, const char *text, struct lp_packet *packet)
{
	lightprobe_v1_FromProbe message = {.which_message = lightprobe_v1_FromProbe_error_tag};

	message.message.error.code = code;
	COPY_TEXT(message.message.error.text, text);
	encode(&message, LP_PACKET_CONTROL, packet);
}
