// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Generic;
using System.IO;

namespace Lightprobe
{
    /// <summary>Writes one message in the encoding of Protocol Buffers; what has its default is left out.</summary>
    internal sealed class WireWriter
    {
        private readonly MemoryStream _bytes = new MemoryStream();

        internal byte[] ToArray() => _bytes.ToArray();

        internal void Varint(ulong value)
        {
            for (; value > 127; value >>= 7) _bytes.WriteByte((byte)(value & 127 | 128));
            _bytes.WriteByte((byte)value);
        }

        internal void UInt32(int field, uint value, bool always = false) => UInt64(field, value, always);

        internal void UInt64(int field, ulong value, bool always = false)
        {
            if (value == 0 && !always) return;
            Tag(field, 0);
            Varint(value);
        }

        internal void Bool(int field, bool value, bool always = false) => UInt64(field, value ? 1UL : 0UL, always);

        internal void Float(int field, float value, bool always = false)
        {
            if (value == 0 && !always) return;
            Tag(field, 5);
            Ordered(BitConverter.GetBytes(value));
        }

        internal void FixedInt64(int field, long value, bool always = false)
        {
            if (value == 0 && !always) return;
            Tag(field, 1);
            Ordered(BitConverter.GetBytes(value));
        }

        internal void Floats(int field, List<float> values)
        {
            if (values.Count == 0) return;
            Tag(field, 2);
            Varint((ulong)(4 * values.Count));
            foreach (float value in values) Ordered(BitConverter.GetBytes(value));
        }

        internal void Message(int field, WireWriter message)
        {
            Tag(field, 2);
            Delimited(message.ToArray());
        }

        /// <summary>A message with its length before it.</summary>
        internal void Delimited(byte[] message)
        {
            Varint((ulong)message.Length);
            _bytes.Write(message, 0, message.Length);
        }

        private void Tag(int field, int type) => Varint((ulong)(field << 3 | type));

        private void Ordered(byte[] bytes)
        {
            if (!BitConverter.IsLittleEndian) Array.Reverse(bytes);
            _bytes.Write(bytes, 0, bytes.Length);
        }
    }
}
