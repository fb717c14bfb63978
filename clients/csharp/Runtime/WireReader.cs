// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Generic;
using System.Text;

namespace Lightprobe
{
    /// <summary>What came is no message of lightprobe.v1. The text names the field.</summary>
    public sealed class WireException : Exception
    {
        internal WireException(string text) : base(text) { }
    }

    /// <summary>Reads one message in the encoding of Protocol Buffers. It never reads beyond its bytes.</summary>
    internal sealed class WireReader
    {
        private const int Varint = 0, Fixed64 = 1, Delimited = 2, Fixed32 = 5;
        private const int MostNested = 16;
        /// <summary>Of messages in one list. Each takes two bytes on the wire at least, but some hundred in memory.</summary>
        private const int MostRepeated = 256;
        private static readonly UTF8Encoding Utf8 = new UTF8Encoding(false, true);

        private readonly byte[] _data;
        private readonly int _end, _depth;
        private int _at, _type;

        internal WireReader(byte[] data, int start, int end, int depth = 0)
        {
            if (depth > MostNested) throw new WireException("messages within messages: more than " + MostNested);
            _data = data;
            _at = start;
            _end = end;
            _depth = depth;
        }

        /// <summary>Goes to the next field. False: the message is over.</summary>
        internal bool Next(out int field)
        {
            field = 0;
            if (_at == _end) return false;
            ulong tag = ReadVarint("a tag");
            _type = (int)(tag & 7);
            if (tag >> 3 == 0 || tag >> 3 > 536870911) throw new WireException("a field of number " + (tag >> 3));
            field = (int)(tag >> 3);
            return true;
        }

        /// <summary>Leaves out a field that is not known: the wire grows.</summary>
        internal void Skip()
        {
            switch (_type)
            {
                case Varint: ReadVarint("an unknown field"); break;
                case Fixed64: Take(8, "an unknown field"); break;
                case Delimited: TakeDelimited("an unknown field"); break;
                case Fixed32: Take(4, "an unknown field"); break;
                default: throw new WireException("wire type " + _type + " of an unknown field");
            }
        }

        internal uint UInt32(string name) => (uint)ReadVarintOf(name);

        internal ulong UInt64(string name) => ReadVarintOf(name);

        internal int Int32(string name) => (int)ReadVarintOf(name);

        internal bool Bool(string name) => ReadVarintOf(name) != 0;

        internal uint FixedUInt32(string name)
        {
            Expect(Fixed32, name);
            return BitConverter.ToUInt32(Take(4, name), 0);
        }

        internal ulong FixedUInt64(string name)
        {
            Expect(Fixed64, name);
            return BitConverter.ToUInt64(Take(8, name), 0);
        }

        internal long FixedInt64(string name) => (long)FixedUInt64(name);

        internal float Float(string name)
        {
            Expect(Fixed32, name);
            return BitConverter.ToSingle(Take(4, name), 0);
        }

        /// <summary>Adds floats, packed or one by one.</summary>
        internal void Floats(string name, List<float> floats)
        {
            if (_type != Delimited)
            {
                floats.Add(Float(name));
                return;
            }
            int start = TakeDelimited(name);
            if ((_at - start) % 4 != 0) throw new WireException(name + ": " + (_at - start) + " bytes are no floats");
            for (; start < _at; start += 4) floats.Add(BitConverter.ToSingle(Ordered(start, 4), 0));
        }

        internal string String(string name)
        {
            int start = TakeDelimited(name);
            try
            {
                return Utf8.GetString(_data, start, _at - start);
            }
            catch (ArgumentException)
            {
                throw new WireException(name + ": is no UTF-8");
            }
        }

        internal byte[] Bytes(string name)
        {
            int start = TakeDelimited(name);
            var bytes = new byte[_at - start];
            Array.Copy(_data, start, bytes, 0, bytes.Length);
            return bytes;
        }

        /// <summary>A reader of the message that this field holds.</summary>
        internal WireReader Message(string name)
        {
            int start = TakeDelimited(name);
            return new WireReader(_data, start, _at, _depth + 1);
        }

        /// <summary>A reader of one more message of a list that has `count` already.</summary>
        internal WireReader Repeated(string name, int count)
        {
            if (count >= MostRepeated) throw new WireException(name + ": more than " + MostRepeated);
            return Message(name);
        }

        internal void Strings(string name, List<string> strings)
        {
            if (strings.Count >= MostRepeated) throw new WireException(name + ": more than " + MostRepeated);
            strings.Add(String(name));
        }

        private void Expect(int type, string name)
        {
            if (_type != type) throw new WireException(name + ": wire type " + _type + ", expected " + type);
        }

        private ulong ReadVarintOf(string name)
        {
            Expect(Varint, name);
            return ReadVarint(name);
        }

        private ulong ReadVarint(string name)
        {
            ulong value = 0;
            for (int shift = 0; shift < 70; shift += 7)
            {
                if (_at == _end) throw new WireException(name + ": the message ends within it");
                byte part = _data[_at++];
                value |= shift < 64 ? (ulong)(part & 127) << shift : 0;
                if (part < 128) return value;
            }
            throw new WireException(name + ": a number of more than ten bytes");
        }

        /// <summary>Moves behind a field with a length; gives where its bytes begin.</summary>
        private int TakeDelimited(string name)
        {
            Expect(Delimited, name);
            ulong length = ReadVarint(name);
            if (length > (ulong)(_end - _at)) throw new WireException(name + ": the message ends within it");
            int start = _at;
            _at += (int)length;
            return start;
        }

        private byte[] Take(int count, string name)
        {
            if (_end - _at < count) throw new WireException(name + ": the message ends within it");
            _at += count;
            return Ordered(_at - count, count);
        }

        /// <summary>Bytes of a number in this machine's order; on the wire they are little-endian.</summary>
        private byte[] Ordered(int start, int count)
        {
            var bytes = new byte[count];
            Array.Copy(_data, start, bytes, 0, count);
            if (!BitConverter.IsLittleEndian) Array.Reverse(bytes);
            return bytes;
        }
    }
}
