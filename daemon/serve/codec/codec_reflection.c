/* SPDX-License-Identifier: Apache-2.0 */
/* Reflection maps on the wire: FromProbe without its C structure, which is to stay small. */
#include <assert.h>
#include <errno.h>
#include <math.h>
#include <pb_encode.h>

#include "base/clock.h"
#include "include/packet.h"
#include "light/send/cube.h"
#include "proto/lightprobe.pb.h"
#include "proto/ranges.h"
#include "serve/codec/codec_fields.h"
#include "serve/codec/codec.h"

#define FROM_PROBE_REFLECTION_MAP 6 /* FromProbe.reflection_map: left out by lightprobe.options */

static_assert(4 * LP_CUBE_MOST_TEXELS + LP_REFLECTION_HEADER_BYTES <= LP_PACKET_LARGE_BYTES,
	      "a publisher has room for the largest map");

struct bytes {
	const uint8_t *data;
	size_t size;
};

static bool write_bytes(pb_ostream_t *stream, const pb_field_t *field, void *const *argument)
{
	const struct bytes *bytes = *argument;

	return pb_encode_tag_for_field(stream, field) &&
	       pb_encode_string(stream, bytes->data, bytes->size);
}

/* A sigma, rounded up: it is never less than stated. */
static bool permille_of(float sigma, uint32_t *permille)
{
	if (isnan(sigma))
		return false;
	*permille = (uint32_t)fminf(fmaxf(ceilf(sigma * 1000.0F), 0.0F), 1e6F);
	return true;
}

bool lp_fill_drawn(lightprobe_v1_Drawn *wire, const struct lp_drawn *drawn)
{
	const float *of = drawn->of;

	wire->has_diffuse_permille = permille_of(of[LP_DRAWN_DIFFUSE], &wire->diffuse_permille);
	wire->has_shadows_permille = permille_of(of[LP_DRAWN_SHADOWS], &wire->shadows_permille);
	wire->has_glossy_permille = permille_of(of[LP_DRAWN_GLOSSY], &wire->glossy_permille);
	wire->has_mirrors_permille = permille_of(of[LP_DRAWN_MIRRORS], &wire->mirrors_permille);
	return wire->has_diffuse_permille || wire->has_shadows_permille ||
	       wire->has_glossy_permille || wire->has_mirrors_permille;
}

static void fill(lightprobe_v1_ReflectionMap *wire, const struct lp_light_estimate *estimate,
		 const struct lp_reflection_header *header, const struct lp_stamp *stamp)
{
	wire->sequence = estimate->sequence;
	wire->boot_id = stamp->boot_id;
	wire->capture_time_unix_ns = (uint64_t)lp_clock_unix_ns(estimate->t_capture_ns);
	wire->subscription = stamp->subscription;
	wire->kind = header->total ? lightprobe_v1_SphericalHarmonics_Kind_TOTAL
				   : lightprobe_v1_SphericalHarmonics_Kind_AMBIENT;
	wire->size = (uint32_t)header->size;
	wire->scale = header->scale;
	wire->has_drawn = lp_fill_drawn(&wire->drawn, &header->drawn);
	wire->orientation_count = estimate->orientation.known ? 4 : 0;
	for (int i = 0; i < 4; i++)
		wire->orientation[i] = estimate->orientation.xyzw[i];
}

int lp_encode_reflection_map(const struct lp_light_estimate *estimate,
			     const struct lp_reflection_header *header, const uint8_t *texels,
			     const struct lp_stamp *stamp, struct lp_packet *packet)
{
	struct bytes bytes = {texels, 4 * (size_t)LP_CUBE_TEXELS(header->size)};
	lightprobe_v1_ReflectionMap wire = lightprobe_v1_ReflectionMap_init_zero;
	pb_ostream_t sizing = PB_OSTREAM_SIZING, stream;
	bool done;

	fill(&wire, estimate, header, stamp);
	if (lp_may_be_sent(lp_keep_ReflectionMap(&wire)) != 0)
		return -ERANGE;
	wire.texels.funcs.encode = write_bytes;
	wire.texels.arg = &bytes;
	done = pb_encode_tag(&sizing, PB_WT_STRING, FROM_PROBE_REFLECTION_MAP) &&
	       pb_encode_submessage(&sizing, lightprobe_v1_ReflectionMap_fields, &wire);
	stream = pb_ostream_from_buffer(packet->data, packet->capacity_bytes);
	done = done && pb_encode_varint(&stream, sizing.bytes_written) &&
	       pb_encode_tag(&stream, PB_WT_STRING, FROM_PROBE_REFLECTION_MAP) &&
	       pb_encode_submessage(&stream, lightprobe_v1_ReflectionMap_fields, &wire);
	assert(done); /* every field is bounded, and the buffer holds them all */
	(void)done;
	packet->kind = LP_PACKET_PICTURE;
	packet->name = "reflection_map";
	packet->size_bytes = (uint32_t)stream.bytes_written;
	return 0;
}
