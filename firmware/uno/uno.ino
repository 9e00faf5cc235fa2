// This file makes the folder an Arduino sketch: open it, choose "Arduino Uno", upload.
// The program is in main.c and the files beside it; README.md lists its promises.
