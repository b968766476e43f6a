"""What watches over the rudder and the boat, and the failsafes; pure."""
