"""GStreamer RTSP server, run by the system's Python. Each image encodes its capture time (1/100 s).

    /usr/bin/python3 rtsp_server.py USER PASSWORD PORT

Prints its port (chosen by the system if PORT is 0) and exits when its standard input closes. On Debian and Ubuntu:
apt install python3-gi gir1.2-gst-rtsp-server-1.0 gstreamer1.0-plugins-base gstreamer1.0-plugins-good
gstreamer1.0-plugins-ugly.
"""

import sys
import threading
import time

import gi
import picture_code  # type: ignore[import-not-found]  # the system's Python runs this, from its folder

gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer  # noqa: E402

RATE_HZ = 25
PIPELINE = (
    f"( appsrc name=born is-live=true do-timestamp=true format=time caps=video/x-raw,format=RGB,"
    f"width={picture_code.WIDTH},height={picture_code.HEIGHT},framerate={RATE_HZ}/1 ! videoconvert !"
    f" video/x-raw,format=I420 ! x264enc tune=zerolatency key-int-max={RATE_HZ} bitrate=2000 !"
    " rtph264pay name=pay0 config-interval=1 )"
)


class Factory(GstRtspServer.RTSPMediaFactory):  # type: ignore[misc]
    """Pushes an image into the pipeline of each client every 40 ms."""

    def do_configure(self, media):
        source = media.get_element().get_by_name("born")
        going = [True]
        media.connect("unprepared", lambda media: going.clear())

        def push():
            if not going:
                return False
            drawn = picture_code.drawn(int(time.monotonic() * 100))
            return source.emit("push-buffer", Gst.Buffer.new_wrapped(drawn)) == Gst.FlowReturn.OK

        GLib.timeout_add(1000 // RATE_HZ, push)


def main() -> None:
    Gst.init(None)
    factory = Factory()
    factory.set_launch(PIPELINE)
    server = GstRtspServer.RTSPServer(address="127.0.0.1", service=sys.argv[3])
    auth = GstRtspServer.RTSPAuth()
    token = GstRtspServer.RTSPToken()
    token.set_string("media.factory.role", "user")
    auth.set_supported_methods(2)  # digest authentication, which most cameras use
    auth.add_digest(*sys.argv[1:3], token)
    server.set_auth(auth)
    permissions = GstRtspServer.RTSPPermissions()
    permissions.add_permission_for_role("user", "media.factory.access", True)
    permissions.add_permission_for_role("user", "media.factory.construct", True)
    factory.set_permissions(permissions)
    server.get_mount_points().add_factory("/live", factory)
    server.attach(None)
    sys.stdout.write(f"{server.get_bound_port()}\n")
    sys.stdout.flush()
    loop = GLib.MainLoop()
    threading.Thread(target=lambda: (sys.stdin.read(), loop.quit()), daemon=True).start()
    loop.run()


main()
