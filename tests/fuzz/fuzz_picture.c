/* SPDX-License-Identifier: Apache-2.0 */
/* A picture file: split into pictures, each copied into a frame. The first byte chooses the
 * encoding and how the bytes arrive. */
#include "fuzz.h"

#include "drivers/source/formats.h"

#define MOST_FRAME_BYTES ((size_t)1 << 20)

static void copy(const struct lp_picture *picture, const uint8_t *data)
{
	uint8_t *frame;

	if (picture->frame_bytes > MOST_FRAME_BYTES)
		return; /* floats may be three times the input: not worth the time */
	frame = malloc(picture->frame_bytes + 1);
	lp_picture_copy(picture, data, frame);
	free(frame);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static const enum lp_encoding encodings[] = {LP_ENCODING_MJPEG, LP_ENCODING_PFM,
						     LP_ENCODING_YUYV, LP_ENCODING_NV12,
						     LP_ENCODING_GREY};
	struct lp_picture picture;
	enum lp_encoding encoding;
	size_t available;
	int ret;

	if (size == 0)
		return 0;
	encoding = encodings[data[0] % 5];
	available = data[0] & 0x80 ? size / 2 : size - 1; /* in two halves, or at once */
	data++;
	size--;
	for (;;) {
		ret = lp_picture_next(encoding, 5, 3, data, available, available == size, &picture);
		fuzz_assert(ret != 0 || available < size);
		if (ret == 1) {
			fuzz_assert(picture.encoded_bytes > 0);
			fuzz_assert(picture.skip_bytes + picture.encoded_bytes <= available);
			copy(&picture, data);
			picture.skip_bytes += picture.encoded_bytes;
		} else if (ret < 0) {
			return 0;
		} else {
			fuzz_assert(picture.skip_bytes <= available);
		}
		data += picture.skip_bytes;
		size -= picture.skip_bytes;
		available = ret == 0 ? size : available - picture.skip_bytes;
	}
}
