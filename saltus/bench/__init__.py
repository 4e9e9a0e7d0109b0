"""Speed against error: tasks whose answers are known to many digits, solved by saltus and by what else there is, on one machine."""
