#!/bin/sh
# Makes the videos of this folder with ffmpeg 5.1 of Debian 12: ./make_videos.sh. All show the same 12 pictures, source.mkv.
set -e
cd "$(dirname "$0")/videos"
f="ffmpeg -nostdin -loglevel error -y"
source="-f lavfi -i testsrc2=size=96x64:rate=25"
x264="-c:v libx264 -preset veryfast -crf 8 -pix_fmt yuv420p -bitexact -threads 1"

$f $source -frames:v 12 -c:v ffv1 -pix_fmt bgr0 source.mkv
s="-i source.mkv"
$f $s -vf format=yuv420p $x264 -g 4 plain.mp4
$f -i plain.mp4 -c copy -bsf:v h264_mp4toannexb no_times.h264
$f -i plain.mp4 -c copy reordered.avi
$f $s -c:v mpeg4 -q:v 2 -bitexact -f m4v no_times.m4v
$f -ss 0.2 -i plain.mp4 -c copy edit_list.mp4
$f -i plain.mp4 -c copy -metadata:s:v:0 rotate=90 rotated.mp4
$f -i plain.mp4 -c copy -metadata:s:v:0 rotate=45 slanted.mp4
$f -i plain.mp4 -c copy -aspect 2 stretched.mp4
$f -i plain.mp4 -c copy -movflags +faststart whole.mp4
head -c "$(($(stat -c %s whole.mp4) * 7 / 10))" whole.mp4 > cut.mp4
rm whole.mp4
$f $s -vf "setpts='round((N*40+mod(N,3)*7)/1000/TB)'" -enc_time_base 1/1000 -vsync passthrough $x264 vfr.mkv
$f $source -frames:v 12 -vf "format=yuv444p,crop=95:63:0:0" -c:v libx264 -crf 8 -bitexact odd.mp4
$f $s -c:v libsvtav1 -preset 10 -crf 10 -pix_fmt yuv420p av1.mp4
$f $s -c:v libx265 -x265-params log-level=error -crf 8 -pix_fmt yuv420p10le -tag:v hvc1 hevc10.mp4
$f $s -c:v libvpx-vp9 -crf 10 -b:v 0 -pix_fmt yuv420p vp9.webm
$f $s -c:v prores_ks -profile:v 1 -pix_fmt yuv422p10le prores.mov
$f $s -c:v mjpeg -q:v 2 -pix_fmt yuvj422p mjpeg.avi
$f -i mjpeg.avi -c copy -bitexact no_times.mjpeg
$f $s -r 12.5 delta.gif
$f -i plain.mp4 -c copy plain.ts
$f -f lavfi -i testsrc2=size=320x240:rate=25 -frames:v 12 -c:v libx265 -preset ultrafast -x265-params log-level=error -pix_fmt yuv420p no_times.hevc
$f $s -c:v mpeg2video -q:v 2 -bitexact plain.mpg
$f $s -c:v libtheora -q:v 8 -bitexact plain.ogv
$f $s -c:v wmv2 -q:v 2 -bitexact plain.wmv
$f $s -vf scale=48:32 -pix_fmt yuv420p plain.y4m
$f $source -frames:v 6 -vf "tinterlace=interleave_top,setfield=tff" $x264 -flags +ildct+ilme -x264opts tff=1 interlaced.mp4
$f $s -f lavfi -i testsrc=size=48x32:rate=25 -frames:v 12 -map 1 -map 0 -c:v mjpeg preview.mp4
$f -f lavfi -t 0.2 -i sine -i source.mkv -frames:v 1 -map 0 -map 1 -c:v mjpeg -disposition:v attached_pic cover.mp4
