// The C example in C#, through P/Invoke: mono Press.exe [DOMAIN]. It finds libhaptic_client.so.0 as ld.so does.
using System;
using System.Runtime.InteropServices;
using System.Text;

static class Press {
  [StructLayout(LayoutKind.Sequential)]
  struct Options {
    public uint size, flags;
    [MarshalAs(UnmanagedType.LPStr)] public string device, keys;
    public uint domain, deviceId;
  }
  [StructLayout(LayoutKind.Sequential, CharSet = CharSet.Ansi)]
  struct Error {
    public uint size;
    public int line;
    [MarshalAs(UnmanagedType.ByValTStr, SizeConst = 256)] public string file;
    [MarshalAs(UnmanagedType.ByValTStr, SizeConst = 64)] public string key;
    [MarshalAs(UnmanagedType.ByValTStr, SizeConst = 1024)] public string message;
  }
  [StructLayout(LayoutKind.Sequential)]
  struct Pose {
    public uint size, buttons;
    public double x, y, z, qx, qy, qz, qw;
    public int enable, reserved;
  }
  [StructLayout(LayoutKind.Sequential)]
  struct Force {
    public uint size, status;
    public double fx, fy, fz, tx, ty, tz;
    public int answered, result;
  }
  [StructLayout(LayoutKind.Sequential)]
  struct State {
    public uint size;
    public int result;
    public ulong sent, answered, silences, strangeForces;
    public double longestSilenceMs;
    public int realtime, reserved;
  }
  const string Library = "libhaptic_client.so.0";
  const int NoDaemon = -1;
  [DllImport(Library)] static extern int haptic_open(ref Options options, out IntPtr client, ref Error error);
  [DllImport(Library)] static extern int haptic_next_slot(IntPtr client);
  [DllImport(Library)] static extern int haptic_exchange(IntPtr client, ref Pose pose, ref Force force);
  [DllImport(Library)] static extern int haptic_get_state(IntPtr client, ref State state);
  [DllImport(Library)] static extern void haptic_explain(IntPtr client, int result, StringBuilder text, UIntPtr size);
  [DllImport(Library)] static extern int haptic_close(IntPtr client);

  static int Main(string[] words) {
    var options = new Options { size = (uint)Marshal.SizeOf(typeof(Options)), device = "touch" };
    if (words.Length > 0) options.domain = uint.Parse(words[0]);
    var error = new Error { size = (uint)Marshal.SizeOf(typeof(Error)) };
    IntPtr client;
    if (haptic_open(ref options, out client, ref error) != 0) {
      Console.Error.WriteLine(error.message);
      return 1;
    }
    var pose = new Pose { size = (uint)Marshal.SizeOf(typeof(Pose)), qw = 1, enable = 1 };
    var force = new Force { size = (uint)Marshal.SizeOf(typeof(Force)) };
    var before = new State { size = (uint)Marshal.SizeOf(typeof(State)) };
    var after = before;
    double peak = 0;
    int slots = -1000;  // a second to be armed and to reach the cube, then ten that count
    for (; slots < 10000; ++slots) {
      if (slots == 0) haptic_get_state(client, ref before);
      haptic_next_slot(client);
      pose.z = slots < 0 ? 0.0215 - 8.5e-6 * slots : 0.0215;
      if (haptic_exchange(client, ref pose, ref force) == NoDaemon) break;
      peak = Math.Max(peak, force.fz);
    }
    haptic_get_state(client, ref after);
    var text = new StringBuilder(1024);
    haptic_explain(client, force.result, text, (UIntPtr)text.Capacity);
    Console.WriteLine("{0} slots, {1} answered, peak force {2:F4} N: {3}", slots, after.answered - before.answered, peak, text);
    haptic_close(client);
    return slots == 10000 ? 0 : 1;
  }
}
