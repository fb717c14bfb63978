/* SPDX-License-Identifier: Apache-2.0 */
/* What clients send. */
#include <assert.h>
#include <errno.h>
#include <math.h>
#include <pb_decode.h>

#include "include/publisher.h"
#include "light/send/cube.h"
#include "proto/lightprobe.pb.h"
#include "serve/codec/codec.h"

#define REFLECTION_RATE_HZ 5.0F /* of a client that does not say */
#define REFLECTION_MOST_HZ 30.0F
#define POSE_SIGMA_DEG 0.2F /* likewise */
#define POSITION_SIGMA_M 0.005
/* Positions are float: beyond this they tell no centimetres. */
#define FARTHEST_M 1e6

static_assert(lightprobe_v1_FromClient_size <= LP_REQUEST_MAX_BYTES,
	      "a request may be as long as the largest message");
struct lp_subscription lp_default_subscription(void)
{
	return (struct lp_subscription){.sh_order = 2, .max_lights = 4};
}

static int read_reflection(const lightprobe_v1_Subscription *wire, struct lp_reflection_wish *wish,
			   const char **reason)
{
	const lightprobe_v1_ReflectionMapWish *map = &wire->reflection_map;

	if (!wire->has_reflection_map || map->size == 0)
		return 0;
	*reason = "reflection_map.size: must be 16, 32 or 64; 0: none";
	if (map->size != 16 && map->size != 32 && map->size != 64)
		return -ERANGE;
	*reason = "reflection_map.rate_hz: must be 0 or a positive number";
	if (!isfinite(map->rate_hz) || map->rate_hz < 0)
		return -ERANGE;
	*reason = "reflection_map.kind: must be AMBIENT or TOTAL";
	if ((int)map->kind < 0 || map->kind > lightprobe_v1_SphericalHarmonics_Kind_TOTAL)
		return -ERANGE;
	wish->size = (int)map->size;
	wish->rate_hz =
		map->rate_hz > 0 ? fminf(map->rate_hz, REFLECTION_MOST_HZ) : REFLECTION_RATE_HZ;
	wish->total = map->kind != lightprobe_v1_SphericalHarmonics_Kind_AMBIENT;
	return 0;
}

static float tolerance_of(bool is_sent, uint32_t permille)
{
	return is_sent ? fminf((float)permille / 1000.0F, 1.0F) : 0.0F;
}

/* What is drawn, and the most that may be sent for it. */
static void read_draws(const lightprobe_v1_Subscription *wire, struct lp_subscription *subscription)
{
	const lightprobe_v1_Drawn *draws = &wire->draws;
	float *of = subscription->draws.of;

	if (!wire->has_draws)
		return;
	subscription->has_draws = true;
	subscription->area_lights = true;
	of[LP_DRAWN_DIFFUSE] = tolerance_of(draws->has_diffuse_permille, draws->diffuse_permille);
	of[LP_DRAWN_SHADOWS] = tolerance_of(draws->has_shadows_permille, draws->shadows_permille);
	of[LP_DRAWN_GLOSSY] = tolerance_of(draws->has_glossy_permille, draws->glossy_permille);
	of[LP_DRAWN_MIRRORS] = tolerance_of(draws->has_mirrors_permille, draws->mirrors_permille);
	if (!wire->has_sh_order)
		subscription->sh_order = LP_MAX_SH_ORDER;
	if (!wire->has_max_lights)
		subscription->max_lights = LP_MAX_LIGHTS;
	if (!wire->has_reflection_map)
		subscription->reflection =
			(struct lp_reflection_wish){.size = LP_CUBE_MOST,
						    .rate_hz = REFLECTION_RATE_HZ,
						    .total = true};
	if (!(of[LP_DRAWN_GLOSSY] > 0.0F) && !(of[LP_DRAWN_MIRRORS] > 0.0F))
		subscription->reflection.size = 0;
}

static int read_subscription(const lightprobe_v1_Subscription *wire,
			     struct lp_subscription *subscription, const char **reason)
{
	*subscription = lp_default_subscription();
	*reason = "rate_hz: must be 0 or a positive number";
	if (!isfinite(wire->rate_hz) || wire->rate_hz < 0)
		return -ERANGE;
	*reason = "kind: must be AMBIENT or TOTAL";
	if ((int)wire->kind < 0 || wire->kind > lightprobe_v1_SphericalHarmonics_Kind_TOTAL)
		return -ERANGE;
	*reason = "smoothing: must be SMOOTHED or RAW";
	if ((int)wire->smoothing < 0 || wire->smoothing > lightprobe_v1_Subscription_Smoothing_RAW)
		return -ERANGE;
	*reason = "frame: must be PROBE or WORLD";
	if ((int)wire->frame < 0 || wire->frame > lightprobe_v1_Estimate_Frame_WORLD)
		return -ERANGE;
	subscription->rate_hz = wire->rate_hz;
	subscription->world = wire->frame == lightprobe_v1_Estimate_Frame_WORLD;
	if (wire->has_sh_order)
		subscription->sh_order =
			wire->sh_order > LP_MAX_SH_ORDER ? LP_MAX_SH_ORDER : (int)wire->sh_order;
	if (wire->has_max_lights)
		subscription->max_lights =
			wire->max_lights > LP_MAX_LIGHTS ? LP_MAX_LIGHTS : (int)wire->max_lights;
	subscription->total = wire->kind == lightprobe_v1_SphericalHarmonics_Kind_TOTAL;
	subscription->raw = wire->smoothing == lightprobe_v1_Subscription_Smoothing_RAW;
	subscription->tolerance = (float)wire->tolerance_permille / 1000.0F;
	subscription->health_period_ms = wire->health_period_ms;
	subscription->quiet_ms =
		wire->quiet_ms > LP_MOST_QUIET_MS ? LP_MOST_QUIET_MS : wire->quiet_ms;
	subscription->number = wire->number;
	subscription->key_light = wire->key_light;
	subscription->area_lights = wire->area_lights;
	subscription->leave_out_reflections = wire->leave_out_reflections;
	const int refused = read_reflection(wire, &subscription->reflection, reason);

	read_draws(wire, subscription);
	return refused;
}

static bool sane_time(int64_t time_ns)
{
	return time_ns >= -LP_MOST_CLIENT_TIME_NS && time_ns <= LP_MOST_CLIENT_TIME_NS;
}

static int read_position(const lightprobe_v1_Pose *wire, struct lp_client_pose *pose,
			 const char **reason)
{
	const bool is_sent = wire->position_count > 0;

	*reason = "position: must be three numbers within 1e6, x y z in metres, or absent";
	if (is_sent && wire->position_count != 3)
		return -ERANGE;
	for (int a = 0; a < 3; a++) {
		pose->position_m[a] = is_sent ? (double)wire->position[a] : NAN;
		if (is_sent && !(fabs(pose->position_m[a]) <= FARTHEST_M))
			return -ERANGE;
	}
	pose->position_sigma_m =
		wire->has_position_sigma_m ? (double)wire->position_sigma_m : POSITION_SIGMA_M;
	*reason = "position_sigma_m: must be a positive number";
	return isfinite(pose->position_sigma_m) && pose->position_sigma_m > 0.0 ? 0 : -ERANGE;
}

static int read_pose(const lightprobe_v1_Pose *wire, struct lp_client_pose *pose,
		     const char **reason)
{
	const float sigma_deg = wire->has_sigma_deg ? wire->sigma_deg : POSE_SIGMA_DEG;

	*reason = "time_ns: must be within 2e18 ns of 0 — use a clock that counts from the start";
	if (!sane_time(wire->time_ns))
		return -ERANGE;
	*reason = "orientation: must be four numbers, x y z w";
	if (wire->orientation_count != 4)
		return -ERANGE;
	*reason = "sigma_deg: must be a positive number";
	if (!isfinite(sigma_deg) || !(sigma_deg > 0.0F))
		return -ERANGE;
	pose->time_ns = wire->time_ns;
	for (int i = 0; i < 4; i++)
		pose->quaternion[i] = wire->orientation[i];
	pose->sigma_rad = sigma_deg * M_PI / 180.0;
	return read_position(wire, pose, reason);
}

static int read_ping(const lightprobe_v1_Ping *wire, struct lp_client_ping *ping,
		     const char **reason)
{
	*reason = "time_ns, pong_time_ns: must be within 2e18 ns of 0 — use a clock that counts "
		  "from the start";
	if (!sane_time(wire->time_ns) || !sane_time(wire->pong_time_ns))
		return -ERANGE;
	*ping = (struct lp_client_ping){.time_ns = wire->time_ns,
					.has_pong_time = wire->has_pong_time_ns,
					.pong_time_ns = wire->pong_time_ns};
	return 0;
}

int lp_decode_request(const uint8_t *data, size_t size_bytes, struct lp_request *request,
		      const char **reason)
{
	lightprobe_v1_FromClient message = lightprobe_v1_FromClient_init_zero;
	pb_istream_t stream = pb_istream_from_buffer(data, size_bytes);

	*request = (struct lp_request){0};
	*reason = "is no lightprobe.v1.FromClient message";
	if (!pb_decode(&stream, lightprobe_v1_FromClient_fields, &message))
		return -EBADMSG;
	switch (message.which_message) {
	case lightprobe_v1_FromClient_subscribe_tag:
		request->kind = LP_REQUEST_SUBSCRIBE;
		return read_subscription(&message.message.subscribe, &request->subscription,
					 reason);
	case lightprobe_v1_FromClient_pose_tag:
		request->kind = LP_REQUEST_POSE;
		return read_pose(&message.message.pose, &request->pose, reason);
	case lightprobe_v1_FromClient_ping_tag:
		request->kind = LP_REQUEST_PING;
		return read_ping(&message.message.ping, &request->ping, reason);
	case lightprobe_v1_FromClient_get_polarization_map_tag:
		request->kind = LP_REQUEST_POLARIZATION_MAP;
		return 0;
	case lightprobe_v1_FromClient_start_sweep_tag:
		request->kind = LP_REQUEST_SWEEP;
		return 0;
	case lightprobe_v1_FromClient_take_stills_tag:
		request->kind = LP_REQUEST_STILLS;
		return 0;
	default:
		*reason = "is not known to this version";
		return -EOPNOTSUPP;
	}
}
