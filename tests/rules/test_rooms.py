"""What rooms.py counts."""

from rooms import Room, rooms

TEXT = """\
#define LEAST 0.5F
#define NAME "text"
#define IF(x) (x)
static const float most_deg = -75.0F;
static const struct options table = {.ratio = 2.0F,
\t\t\t\t      .name = "a",
\t\t\t\t      .area_sr = 1.2F};

static int first(int a)
{
\tconst int count = 3;

\treturn a + count;
}

bool second(struct thing *thing, const float direction[3],
\t    float axis[2])
{
\tif (thing) {
\t}
\treturn false;
}
"""


def test_lines_functions_and_named_numbers_are_counted():
    room = Room()
    room.add(TEXT)
    assert (room.files, room.lines, room.functions) == (1, 22, 2)
    assert room.numbers == 5


def test_rooms_that_estimate_have_a_sum():
    found = rooms(iter([("daemon/light/a.c", TEXT), ("daemon/vision/jpeg/b.c", TEXT)]))
    assert found["light"].lines == found["vision"].lines == 22
    assert found["light + vision + estimate"].lines == 44
