// SPDX-License-Identifier: Apache-2.0
// What the tests ask of the package: one word says what, the rest comes on standard input, the answer is JSON lines.
using System;
using System.Collections;
using System.Globalization;
using System.IO;
using System.Linq;
using System.Reflection;
using System.Threading;
using Lightprobe;
using Lightprobe.Messages;

static class Checks
{
    static int Main(string[] arguments)
    {
        switch (arguments[0])
        {
            case "decode": foreach (string line in Lines()) Decode(line); return 0;
            case "subscribe": Console.WriteLine(Hex(TcpConnection.Delimited(Probe.Encoded(Wish())))); return 0;
            case "check": foreach (string line in Lines()) Check(line); return 0;
            case "reflection": foreach (string line in Lines()) Reflection(line); return 0;
            case "unity": foreach (string line in Lines()) Unity(line); return 0;
            case "place": foreach (string line in Lines()) PlaceOf(line); return 0;
            case "ambient": foreach (string line in Lines()) AmbientOf(line); return 0;
            case "live": return Live(arguments[1], int.Parse(arguments[2]));
            case "pause": return Pause(arguments[1]);
            case "old": return Old(arguments[1]);
            case "fallback": foreach (string line in Lines()) Console.WriteLine(Json(Fallback.Estimate(line == "" ? null : Probe.Decode(TcpConnection.Read(new MemoryStream(Bytes(line)))).Estimate).Sh)); return 0;
            case "address": return Address(arguments[1]);
            default: return 2;
        }
    }

    static System.Collections.Generic.IEnumerable<string> Lines()
    {
        for (string line; (line = Console.ReadLine()) != null;) yield return line;
    }

    static byte[] Bytes(string hex) =>
        Enumerable.Range(0, hex.Length / 2).Select(i => byte.Parse(hex.Substring(2 * i, 2), NumberStyles.HexNumber)).ToArray();

    static string Hex(byte[] bytes) => string.Concat(bytes.Select(b => b.ToString("x2")));

    /// <summary>Through the stream, as messages come, with their lengths.</summary>
    static void Decode(string hex)
    {
        try
        {
            byte[] data = TcpConnection.Read(new MemoryStream(Bytes(hex)));
            Console.WriteLine(data == null ? "\"end\"" : Json(Probe.Decode(data)));
        }
        catch (WireException error)
        {
            Console.WriteLine("\"refused: " + error.Message + "\"");
        }
    }

    /// <summary>As a client takes it: decoded, then looked at.</summary>
    static void Check(string hex)
    {
        try
        {
            string refusal = Ranges.Broken(Probe.Decode(TcpConnection.Read(new MemoryStream(Bytes(hex)))));
            Console.WriteLine(Json(refusal == null ? "taken" : "refused: " + refusal));
        }
        catch (WireException error)
        {
            Console.WriteLine("\"refused: " + error.Message + "\"");
        }
    }

    /// <summary>The six faces of a reflection map in Unity's axes.</summary>
    static void Reflection(string hex)
    {
        ReflectionMap map = Probe.Decode(TcpConnection.Read(new MemoryStream(Bytes(hex)))).ReflectionMap;
        for (int face = 0; face < 6; face++) Console.WriteLine(Json(UnityReflection.Face(map, face)));
    }

    /// <summary>The lamps of an estimate from a place: three numbers, then the message.</summary>
    static void PlaceOf(string line)
    {
        string[] words = line.Split(' ');
        double[] at = words.Take(3).Select(word => double.Parse(word, CultureInfo.InvariantCulture)).ToArray();
        Estimate estimate = Probe.Decode(TcpConnection.Read(new MemoryStream(Bytes(words[3])))).Estimate;
        Console.WriteLine(Json(Place.Lights(estimate, at[0], at[1], at[2])[0]));
    }

    /// <summary>The SH of an estimate from a place: three numbers, then the message.</summary>
    static void AmbientOf(string line)
    {
        string[] words = line.Split(' ');
        double[] at = words.Take(3).Select(word => double.Parse(word, CultureInfo.InvariantCulture)).ToArray();
        Estimate estimate = Probe.Decode(TcpConnection.Read(new MemoryStream(Bytes(words[3])))).Estimate;
        Console.WriteLine(Json(Place.Ambient(estimate, at[0], at[1], at[2]).Coefficients));
    }

    static Subscription Wish() => new Subscription
    {
        RateHz = 30, ShOrder = 0, MaxLights = 8, Kind = SphericalHarmonicsKind.Total, Number = 300, KeyLight = true,
        ReflectionMap = new ReflectionMapWish { Size = 32, RateHz = 2.5f },
    };

    /// <summary>Of an estimate's first lamp and SH, what Unity gets: relative in URP, in lux and cd/m² in HDRP.</summary>
    static void Unity(string hex)
    {
        Estimate estimate = Probe.Decode(TcpConnection.Read(new MemoryStream(Bytes(hex)))).Estimate;
        foreach (Pipeline pipeline in new[] { Pipeline.Universal, Pipeline.HighDefinition })
        {
            float scale = estimate.CdM2PerUnit ?? 1;
            var lamp = new UnityLight(estimate.Lights[0], pipeline, scale);
            float[,] sh = UnityLight.SphericalHarmonicsL2(estimate.Sh, pipeline == Pipeline.HighDefinition ? scale : 1);
            Console.WriteLine(Json(lamp.Forward.Concat(lamp.Colour).Concat(new[] { lamp.Intensity }).Concat(sh.Cast<float>()).Concat(new[] { lamp.ShadowStrength ?? -1f, lamp.CastsShadow ? 1f : 0f }).ToArray()));
        }
    }

    /// <summary>Prints every estimate for so many seconds; then why there was nothing, if so.</summary>
    static int Live(string address, int seconds)
    {
        var until = DateTime.UtcNow.AddSeconds(seconds);
        using (var probe = new Probe(address))
            while (DateTime.UtcNow < until)
            {
                Estimate estimate = probe.WaitForNext(200);
                Console.WriteLine(estimate == null ? "{\"error\":" + Json(probe.LastError) + ",\"stale\":" + Json(probe.Latest == null) + "}" : Json(estimate));
            }
        return 0;
    }

    /// <summary>Whether the first estimate is there as soon as it has come.</summary>
    static int Old(string address)
    {
        using (var probe = new Probe(address))
        {
            Estimate first = probe.WaitForNext(30000);
            Console.WriteLine("{\"came\":" + Json(first != null) + ",\"old\":" + Json(probe.Latest == null) + "}");
        }
        return 0;
    }

    /// <summary>Says when there is light; then, after it was stopped for a second or more, how often there was none since.</summary>
    static int Pause(string address)
    {
        using (var probe = new Probe(address))
        {
            while (probe.Latest == null || probe.Health == null) Thread.Sleep(1);
            int dark = 0;
            var clock = System.Diagnostics.Stopwatch.StartNew();
            Console.WriteLine("\"lit\""); // it may be stopped from here on
            for (long before = 0, until = long.MaxValue; clock.ElapsedMilliseconds < until; Thread.Sleep(1))
            {
                if (probe.Latest == null) dark++;
                long now = clock.ElapsedMilliseconds;
                if (until == long.MaxValue && now - before > 3000) until = now + 1000;
                before = now;
            }
            Console.WriteLine("{\"dark\":" + dark + ",\"error\":" + Json(probe.LastError) + "}");
        }
        return 0;
    }

    static int Address(string address)
    {
        try
        {
            new Probe(address).Dispose();
            return 0;
        }
        catch (ArgumentException error)
        {
            Console.WriteLine(error.Message);
            return 1;
        }
    }

    static string Json(object value)
    {
        if (value == null) return "null";
        if (value is bool) return (bool)value ? "true" : "false";
        if (value is string) return "\"" + ((string)value).Replace("\\", "\\\\").Replace("\"", "\\\"").Replace("\n", " ").Replace("\r", " ") + "\"";
        if (value is byte[]) return Json(Hex((byte[])value));
        if (value is float) return Number((float)value);
        if (value is Enum) return Convert.ToUInt64(value).ToString();
        if (value is IEnumerable) return "[" + string.Join(",", ((IEnumerable)value).Cast<object>().Select(Json)) + "]";
        if (value is IFormattable) return ((IFormattable)value).ToString(null, CultureInfo.InvariantCulture);
        return "{" + string.Join(",", value.GetType().GetFields(BindingFlags.Public | BindingFlags.Instance).Select(f => "\"" + f.Name + "\":" + Json(f.GetValue(value)))) + "}";
    }

    static string Number(float number)
    {
        string text = number.ToString("R", CultureInfo.InvariantCulture);
        return float.IsNaN(number) || float.IsInfinity(number) ? "\"" + text + "\"" : text;
    }
}
